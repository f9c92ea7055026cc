"""Velocities at the start of each episode of a recording, with their uncertainty.

An episode that begins at rest starts at exactly zero velocity. An episode cut out of a motion starts at the measured
velocity. If velocities were computed from positions, it starts at the slope of a polynomial fitted to the first
positions (Savitzky and Golay, 1964). `gap`, `evaluate` and the training of φ and ψ use the same rule.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.noise import ODD, ORDERS, estimate_noise, estimate_resolution
from nas_data.dataset.transitions import estimate_velocities

SIGNIFICANT_DEVIATIONS = (
    5.0  # standard deviations of a significant velocity; noise exceeds them once in two million readings
)
SLOW_SHARE = 0.05  # share of a joint's large speed; a slower derived velocity may belong to a start from rest
SETTLING_SHARE = 0.01  # likewise of a measured one, such as the last of the settling before a recording
CUT_EPISODE_SHARE = 1 / 3  # share of episodes in motion from which all count as cut out of motions
LONGEST = 0.15  # [s] longest fit; a hobby arm's motion has hardly any frequency above 3 Hz
WIDTHS = (4, 5, 7, 10, 14, 20, 28, 40, 56, 80, 112, 160)  # number of readings in a fit
ROUNDING_SHARE = 1e-4  # share of a joint's largest speed; rounding error of position differences in single precision
EDGE_ROWS = 2  # rows at either end of an episode in which difference formulas lack a neighbour
LARGE_PERCENTILE = 98  # percentile of the speeds that counts as a large speed
SINGLE_PRECISION = 6e-8  # relative rounding of a stored position


@dataclass(frozen=True)
class StartVelocities:
    """Start velocities of E episodes of n joints.

    Attributes:
        values: Velocities [rad/s; m/s], shape (E, n).
        deviations: Standard deviations of the velocities, shape (E, n); 0 for an episode that begins at rest.
        derived: Whether the velocities of each joint were computed from its positions, shape (n,).
        noise: Standard deviation of the position readings [rad; m], shape (n,).
    """

    values: np.ndarray
    deviations: np.ndarray
    derived: np.ndarray
    noise: np.ndarray


def find_start_velocities(dataset: Dataset) -> StartVelocities:
    """Return the velocities at which the episodes of a recording begin.

    Velocities that are significant by their uncertainty are kept, others are set to zero. All are kept if a third of
    the episodes have a significant one, because the recording was then cut out of motions. All are also kept under
    torque commands, because nothing holds such an arm at rest. An episode whose first velocities are all exactly zero
    begins at rest.

    Args:
        dataset: Transitions with 2n-states.
    """
    n, filled = len(dataset.joints), np.flatnonzero(dataset.lengths > 0)
    values: np.ndarray = np.zeros((dataset.n_episodes, n))
    deviations: np.ndarray = np.zeros((dataset.n_episodes, n))
    episodes = [dataset.states[rows].astype(float) for rows in dataset.episodes() if rows.stop > rows.start]
    positions, velocities = [rows[:, :n] for rows in episodes], [rows[:, n:] for rows in episodes]
    derived = detect_derived_velocities(positions, velocities, dataset.fps)
    noise = estimate_position_noise(positions)
    for joint in range(n):
        if derived[joint]:
            readings = [with_last(dataset, rows, joint) for rows in dataset.episodes() if rows.stop > rows.start]
            found = [fit_velocity(row, 0, float(noise[joint]), dataset.fps) for row in readings]
            values[filled, joint], deviations[filled, joint] = np.array(found).T
        else:
            values[filled, joint] = [rows[0, joint] for rows in velocities]
            deviations[filled, joint] = estimate_velocity_noise([rows[:, joint] for rows in velocities])
    rest = np.zeros((dataset.n_episodes, 1), bool)  # episodes that the recorder reports at rest
    rest[filled] = [[not rows[0].any()] for rows in velocities]
    values, deviations = np.where(rest, 0.0, values), np.where(rest, 0.0, deviations)
    least = np.where(derived, SLOW_SHARE, SETTLING_SHARE) * compute_large_speeds(positions, dataset.fps)
    moving = np.abs(values) > np.maximum(SIGNIFICANT_DEVIATIONS * deviations, least)
    if dataset.commands_positions and moving.any(axis=1).sum() < max(CUT_EPISODE_SHARE * len(filled), 1):
        values, deviations = np.where(moving, values, 0.0), np.where(moving, deviations, 0.0)
    return StartVelocities(values, deviations, derived, noise)


def with_last(dataset: Dataset, rows: slice, joint: int) -> np.ndarray:
    """Return all positions of an episode, including the one after the last command, shape (T + 1,)."""
    return np.append(dataset.states[rows, joint], dataset.next_states[rows.stop - 1, joint]).astype(float)


def estimate_position_noise(positions: Sequence[np.ndarray]) -> np.ndarray:
    """Return the standard deviation of position readings, including rounding, for episodes (T, n); shape (n,)."""
    found = []
    for joint in range(positions[0].shape[1] if positions else 0):
        readings = [rows[:, joint] for rows in positions]
        step, largest = estimate_resolution(readings), max(float(np.abs(row).max()) for row in readings)
        noise = min(estimate_noise(readings, order, step) for order in (*ODD, *ORDERS))
        found.append(max(step / np.sqrt(12.0), SINGLE_PRECISION * largest, noise if np.isfinite(noise) else 0.0))
    return np.array(found)


def fit_velocity(positions: np.ndarray, row: int, noise: float, fps: float) -> tuple[float, float]:
    """Estimate a joint's velocity at one row of an episode.

    Quadratics are fitted to windows of increasing width around the row. A wide window averages the noise, a narrow one
    follows the motion; the fit with the least uncertainty is used. The uncertainty has two parts: the noise in the
    slope of a cubic fitted to the same window, and the bias, estimated by the difference of the two slopes. The larger
    bias of the window and of the next wider one is used. In a single window the slopes may agree by chance, and the
    minimum over windows would select that one.

    Args:
        positions: Positions of one joint in one episode [rad; m], shape (T,).
        row: Index of the row.
        noise: Standard deviation of a reading.
        fps: Rate [Hz].

    Returns:
        Velocity and its standard deviation [rad/s; m/s].
    """
    if len(positions) < WIDTHS[0]:
        slope = float(positions[-1] - positions[0]) * fps / max(1, len(positions) - 1)
        return slope, abs(slope) + noise * fps
    found = []
    for first, quadratic, cubic in list_slope_windows(len(positions), row, max(WIDTHS[0], round(LONGEST * fps))):
        readings = positions[first : first + len(quadratic)] - positions[first]
        moved = quadratic @ readings
        found.append((moved, noise * np.linalg.norm(cubic), abs(moved - cubic @ readings)))
    slope, chance, missed = np.array(found).T
    doubts = np.hypot(chance, np.maximum(missed, np.append(missed[1:], missed[-1])))
    best = int(doubts[: max(1, len(found) - 1)].argmin())  # the last window only serves the one before it
    return float(slope[best]) * fps, float(doubts[best]) * fps


def list_slope_windows(length: int, row: int, longest: int) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
    """Yield windows around a row: first reading, and weights for the slopes per row of a quadratic and of a cubic.

    The last window is the first one longer than `longest`, if the episode is long enough.
    """
    narrower = 0
    for width in WIDTHS:
        if width > length or narrower > longest:
            return
        first = int(np.clip(row - width // 2, 0, length - width))
        yield first, compute_slope_weights(width, row - first, 2), compute_slope_weights(width, row - first, 3)
        narrower = width


@cache
def compute_slope_weights(width: int, at: int, degree: int) -> np.ndarray:
    """Return weights of evenly spaced readings for the slope per row of a fitted polynomial at one reading."""
    powers = np.vander(np.arange(width) - at, degree + 1, increasing=True)
    return np.asarray(np.linalg.pinv(powers)[1])


def compute_large_speeds(positions: Sequence[np.ndarray], fps: float) -> np.ndarray:
    """Return the 98th percentile of each joint's speed over 50 ms [rad/s; m/s], for episodes (T, n); shape (n,)."""
    reach = max(1, round(0.05 * fps))
    steps = [np.abs(rows[reach:] - rows[:-reach]) for rows in positions if len(rows) > reach]
    if not steps:
        return np.zeros(positions[0].shape[1] if positions else 0)
    return np.asarray(np.percentile(np.concatenate(steps), LARGE_PERCENTILE, axis=0) * fps / reach)


def estimate_velocity_noise(velocities: Sequence[np.ndarray]) -> float:
    """Return the standard deviation of one joint's velocity readings [rad/s; m/s], for episodes (T,)."""
    step = estimate_resolution(velocities)
    return max(step / float(np.sqrt(12.0)), min(estimate_noise(velocities, order, step) for order in (*ODD, *ORDERS)))


def detect_derived_velocities(
    positions: Sequence[np.ndarray], velocities: Sequence[np.ndarray], fps: float
) -> np.ndarray:
    """Return a mask of the joints whose velocities were computed from positions by a common formula, shape (n,).

    Args:
        positions: Positions of each episode [rad], shape (T, n).
        velocities: Velocities of each episode [rad/s], shape (T, n).
        fps: Rate [Hz].
    """
    largest = np.max([np.abs(rows).max(axis=0) for rows in velocities], axis=0)
    same = np.ones((4, len(largest)), bool)
    for rows, speeds in zip(positions, velocities, strict=True):
        if len(rows) > 2 * EDGE_ROWS and same.any():
            inner = slice(EDGE_ROWS, len(rows) - EDGE_ROWS)
            same &= (
                np.abs(compute_candidate_velocities(rows, fps) - speeds)[:, inner].max(axis=1)
                <= ROUNDING_SHARE * largest
            )
    return np.asarray(same.any(axis=0))


def compute_candidate_velocities(positions: np.ndarray, fps: float) -> np.ndarray:
    """Return one episode's velocities by backward, forward and central differences and by ours, shape (4, T, n)."""
    steps = np.diff(positions, axis=0) * fps
    still = np.zeros_like(steps[:1])
    backward, forward = np.concatenate([still, steps]), np.concatenate([steps, still])
    return np.stack([backward, forward, (backward + forward) / 2, estimate_velocities(positions, fps)])
