"""How fast episodes began: the measured velocities of their first rows, as far as these are more than noise."""

from collections.abc import Sequence

import numpy as np

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.transitions import estimate_velocities
from nas_data.gap.floor import ODD, ORDERS, resolution, spread

CLEAR = 5.0  # standard deviations beyond which a reading is no noise: once in two million readings
SAME = 1e-4  # share of a joint's greatest speed by which single precision changes differences of positions
EDGE = 2  # rows at either end of an episode where formulas for differences lack a neighbour


def start_speeds(dataset: Dataset) -> np.ndarray:
    """Return the velocities at which episodes began, zero where they began at rest as far as one can tell.

    Velocities computed from positions are no measurement of a start: of what came before the first row they know
    nothing. Of others those count that stand out of their noise. Nothing holds an arm under torque commands at rest,
    so that all of its velocities count that are more than rounding.

    Args:
        dataset: Transitions with 2n-states.

    Returns:
        Velocities [rad/s], shape (E, n).
    """
    n, begun = len(dataset.joints), dataset.lengths > 0
    speeds = np.zeros((dataset.n_episodes, n))
    speeds[begun] = dataset.states[dataset.starts[begun], n:]
    episodes = [dataset.states[rows].astype(float) for rows in dataset.episodes() if rows.stop > rows.start]
    measured = ~differenced([states[:, :n] for states in episodes], [states[:, n:] for states in episodes], dataset.fps)
    noise = [velocity_noise([states[:, n + j] for states in episodes], dataset.commands_effort) for j in range(n)]
    return np.where(measured & (np.abs(speeds) > CLEAR * np.array(noise)), speeds, 0.0)


def velocity_noise(velocities: Sequence[np.ndarray], effort: bool) -> float:
    """Return what the standard deviation of one joint's velocity readings [rad/s] is at most.

    Args:
        velocities: Readings of each episode, shape (T,).
        effort: Whether torques are commanded: then velocities jump, and of noise only rounding can be told from motion.
    """
    step = resolution(velocities)
    rounding = step / float(np.sqrt(12.0))
    return rounding if effort else max(rounding, min(spread(velocities, order, step) for order in (*ODD, *ORDERS)))


def differenced(positions: Sequence[np.ndarray], velocities: Sequence[np.ndarray], fps: float) -> np.ndarray:
    """Return of which joints the velocities were computed from the positions, by any usual formula; shape (n,).

    Args:
        positions: Of each episode [rad], shape (T, n).
        velocities: Likewise [rad/s].
        fps: Rate [Hz].
    """
    largest = np.max([np.abs(rows).max(axis=0) for rows in velocities], axis=0)
    same = np.ones((4, len(largest)), bool)
    for rows, speeds in zip(positions, velocities, strict=True):
        if len(rows) > 2 * EDGE and same.any():
            inner = slice(EDGE, len(rows) - EDGE)
            same &= np.abs(formulas(rows, fps) - speeds)[:, inner].max(axis=1) <= SAME * largest
    return np.asarray(same.any(axis=0))


def formulas(positions: np.ndarray, fps: float) -> np.ndarray:
    """Return one episode's velocities by backward, forward and central differences and by ours, shape (4, T, n)."""
    steps = np.diff(positions, axis=0) * fps
    still = np.zeros_like(steps[:1])
    backward, forward = np.concatenate([still, steps]), np.concatenate([steps, still])
    return np.stack([backward, forward, (backward + forward) / 2, estimate_velocities(positions, fps)])
