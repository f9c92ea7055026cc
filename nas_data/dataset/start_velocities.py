"""How fast every episode of a recording begins, with the uncertainty of that.

Episodes that begin at rest start at zero: whatever holds an arm still holds it exactly. Episodes cut out of a motion
start at the velocity that was measured or, where velocities were computed from positions, at the slope of a
polynomial fitted to the first positions (Savitzky and Golay, 1964). One rule decides for `gap`, `evaluate` and the
training of φ and ψ.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.noise import ODD, ORDERS, noise_of_differences, resolution
from nas_data.dataset.transitions import estimate_velocities

CLEAR = 5.0  # standard deviations from which a velocity is no noise: once in two million readings
SLOW = 0.05  # share of a joint's large speed up to which a derived velocity may be a start from rest, seen too late
CUT = 1 / 3  # share of the episodes that must begin in motion for all to count as cut out of motions
LONGEST = 0.15  # [s] of positions that tell a velocity: a hobby arm's motion has hardly a frequency above 3 Hz
WIDTHS = (4, 5, 7, 10, 14, 20, 28, 40, 56, 80, 112, 160)  # readings to which a polynomial is fitted
SAME = 1e-4  # share of a joint's greatest speed by which single precision changes differences of positions
EDGE = 2  # rows at either end of an episode where formulas for differences lack a neighbour
LARGE = 98  # percentile of the speeds that is called large
SINGLE = 6e-8  # relative rounding of a stored position


@dataclass(frozen=True)
class StartVelocities:
    """Velocities with which E episodes of n joints begin.

    Attributes:
        values: [rad/s; m/s], shape (E, n).
        deviations: Their standard deviations, shape (E, n); 0 where an episode begins at rest.
        derived: Of which joints the velocities were computed from the positions, shape (n,).
        noise: Standard deviation of the position readings [rad; m], shape (n,).
    """

    values: np.ndarray
    deviations: np.ndarray
    derived: np.ndarray
    noise: np.ndarray


def find_start_velocities(dataset: Dataset) -> StartVelocities:
    """Decide how fast the episodes of a recording begin.

    A velocity counts that stands out of its uncertainty. Where a third of the episodes begin with one, the recording
    was cut out of motions, and all velocities count. So they do under torque commands: nothing holds such an arm at
    rest. An episode whose first velocities are all exactly zero begins at rest.

    Args:
        dataset: Transitions with 2n-states.
    """
    free, n, begun = not dataset.commands_positions, len(dataset.joints), np.flatnonzero(dataset.lengths > 0)
    values: np.ndarray = np.zeros((dataset.n_episodes, n))
    deviations: np.ndarray = np.zeros((dataset.n_episodes, n))
    episodes = [dataset.states[rows].astype(float) for rows in dataset.episodes() if rows.stop > rows.start]
    positions, velocities = [rows[:, :n] for rows in episodes], [rows[:, n:] for rows in episodes]
    derived = derived_velocities(positions, velocities, dataset.fps)
    noise = position_noise(positions)
    for joint in range(n):
        if derived[joint]:
            readings = [with_last(dataset, rows, joint) for rows in dataset.episodes() if rows.stop > rows.start]
            found = [fit_velocity(row, 0, float(noise[joint]), dataset.fps) for row in readings]
            values[begun, joint], deviations[begun, joint] = np.array(found).T
        else:
            values[begun, joint] = [rows[0, joint] for rows in velocities]
            deviations[begun, joint] = velocity_noise([rows[:, joint] for rows in velocities], free)
    rest = np.zeros((dataset.n_episodes, 1), bool)  # of which the recorder itself says that it began at rest
    rest[begun] = [[not rows[0].any()] for rows in velocities]
    values, deviations = np.where(rest, 0.0, values), np.where(rest, 0.0, deviations)
    least = np.where(derived, SLOW * large_speeds(positions, dataset.fps), 0.0)
    moving = np.abs(values) > np.maximum(CLEAR * deviations, least)
    if dataset.commands_positions and moving.any(axis=1).sum() < max(CUT * len(begun), 1):
        values, deviations = np.where(moving, values, 0.0), np.where(moving, deviations, 0.0)
    return StartVelocities(values, deviations, derived, noise)


def with_last(dataset: Dataset, rows: slice, joint: int) -> np.ndarray:
    """Return all positions of an episode, the one after the last command included, shape (T + 1,)."""
    return np.append(dataset.states[rows, joint], dataset.next_states[rows.stop - 1, joint]).astype(float)


def position_noise(positions: Sequence[np.ndarray]) -> np.ndarray:
    """Return the standard deviation of position readings, rounding included, for episodes (T, n); shape (n,)."""
    found = []
    for joint in range(positions[0].shape[1] if positions else 0):
        readings = [rows[:, joint] for rows in positions]
        step, largest = resolution(readings), max(float(np.abs(row).max()) for row in readings)
        noise = min(noise_of_differences(readings, order, step) for order in (*ODD, *ORDERS))
        found.append(max(step / np.sqrt(12.0), SINGLE * largest, noise if np.isfinite(noise) else 0.0))
    return np.array(found)


def fit_velocity(positions: np.ndarray, row: int, noise: float, fps: float) -> tuple[float, float]:
    """Estimate a joint's velocity at one row of an episode.

    Quadratics are fitted to more and more readings around the row. A wide fit averages the noise away, a narrow one
    follows the motion; the one of least uncertainty counts. Its uncertainty is that of the cubic fitted to the same
    readings, and how far the two slopes lie apart, there or over the next wider window, which tells what a quadratic
    misses: in one window alone the two may agree by chance, and of many windows the least uncertain one would be that.

    Args:
        positions: Of one joint in one episode [rad; m], shape (T,).
        row: At which row.
        noise: Standard deviation of a reading.
        fps: Rate [Hz].

    Returns:
        Velocity and its standard deviation [rad/s; m/s].
    """
    if len(positions) < WIDTHS[0]:
        slope = float(positions[-1] - positions[0]) * fps / max(1, len(positions) - 1)
        return slope, abs(slope) + noise * fps
    found = []
    for first, quadratic, cubic in slopes(len(positions), row, max(WIDTHS[0], round(LONGEST * fps))):
        readings = positions[first : first + len(quadratic)] - positions[first]
        moved = quadratic @ readings
        found.append((moved, noise * np.linalg.norm(cubic), abs(moved - cubic @ readings)))
    slope, chance, missed = np.array(found).T
    doubts = np.hypot(chance, np.maximum(missed, np.append(missed[1:], missed[-1])))
    best = int(doubts[: max(1, len(found) - 1)].argmin())  # the last window only judges the one before it
    return float(slope[best]) * fps, float(doubts[best]) * fps


def slopes(length: int, row: int, longest: int) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
    """Yield windows about a row: first reading, and the weights whose sums are the slopes per row there.

    The last window is the first that is longer than `longest`, where the episode has room for it.
    """
    narrower = 0
    for width in WIDTHS:
        if width > length or narrower > longest:
            return
        first = int(np.clip(row - width // 2, 0, length - width))
        yield first, slope_weights(width, row - first, 2), slope_weights(width, row - first, 3)
        narrower = width


@cache
def slope_weights(width: int, at: int, degree: int) -> np.ndarray:
    """Return weights of evenly spaced readings that give the slope per row of a fitted polynomial at one of them."""
    powers = np.vander(np.arange(width) - at, degree + 1, increasing=True)
    return np.asarray(np.linalg.pinv(powers)[1])


def large_speeds(positions: Sequence[np.ndarray], fps: float) -> np.ndarray:
    """Return the 98th percentile of each joint's speed over 50 ms [rad/s; m/s], for episodes (T, n); shape (n,)."""
    reach = max(1, round(0.05 * fps))
    steps = [np.abs(rows[reach:] - rows[:-reach]) for rows in positions if len(rows) > reach]
    if not steps:
        return np.zeros(positions[0].shape[1] if positions else 0)
    return np.asarray(np.percentile(np.concatenate(steps), LARGE, axis=0) * fps / reach)


def velocity_noise(velocities: Sequence[np.ndarray], effort: bool) -> float:
    """Return what the standard deviation of one joint's velocity readings [rad/s] is at most.

    Args:
        velocities: Of each episode, shape (T,).
        effort: Whether torques are commanded; then only the rounding counts.
    """
    step = resolution(velocities)
    rounding = step / float(np.sqrt(12.0))
    return (
        rounding
        if effort
        else max(rounding, min(noise_of_differences(velocities, order, step) for order in (*ODD, *ORDERS)))
    )


def derived_velocities(positions: Sequence[np.ndarray], velocities: Sequence[np.ndarray], fps: float) -> np.ndarray:
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
