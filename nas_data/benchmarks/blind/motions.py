"""Commands as other arms are moved: steps held for drawn times, ramps, minimum-jerk moves, sums of sines."""

from collections.abc import Callable, Mapping

import numpy as np

from nas_data.benchmarks.blind.conditions import Conditions
from nas_data.benchmarks.blind.excitation import as_stored

MIXTURE = "mixture"
FARTHEST = 0.9  # [rad] from zero: overshoot stays within a turn's quarter
LASTS = (0.4, 1.5)  # [s] of a step or a move
MOVING = (0.5, 1.0)  # share of a move's time, which ends at rest
SINES, FREQUENCIES = 3, (0.15, 1.5)  # how many of [Hz]

# share of a move's time → share of its way; minimum jerk as in Flash and Hogan, J. Neurosci. 5 (1985) 1688
PROFILES: Mapping[str, Callable[[np.ndarray], np.ndarray]] = {
    "steps": np.ones_like,
    "ramps": lambda time: time,
    "minimum_jerk": lambda time: time**3 * (10 - 15 * time + 6 * time**2),
}
SIGNALS = (*PROFILES, "sines", MIXTURE)


def draw_motions(
    conditions: Conditions, episodes: int, control: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Draw one set of episodes.

    Args:
        conditions: Rate and length; the signal is one of `SIGNALS`, a mixture another one in each episode.
        episodes: How many, E.
        control: Lowest and highest command of each joint [rad], shape (n, 2); infinite for no limit.
        rng: Source of randomness.

    Returns:
        Commands (E, T, n) and the poses held before (E, n), rounded to single precision as stored.
    """
    drawn = [draw_episode(conditions, len(control), rng) for _ in range(episodes)]
    commands, poses = (np.clip(np.stack(values), *control.T) for values in zip(*drawn, strict=True))
    return as_stored(commands), as_stored(poses)


def draw_episode(conditions: Conditions, joints: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return commands (T, n) and the pose (n,) before them."""
    kinds = [name for name in SIGNALS if name != MIXTURE]
    kind = str(rng.choice(kinds)) if conditions.signal == MIXTURE else conditions.signal
    times = np.arange(conditions.steps) * conditions.period
    courses = [draw_sines(times, rng) if kind == "sines" else draw_moves(kind, times, rng) for _ in range(joints)]
    commands, poses = zip(*courses, strict=True)
    return np.stack(commands, axis=1), np.array(poses)


def draw_sines(times: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, float]:
    """Return a sum of sines [rad], scaled to a drawn amplitude, and where it begins."""
    phases = 2 * np.pi * (np.outer(times, rng.uniform(*FREQUENCIES, SINES)) + rng.random(SINES))
    course = np.sin(phases) @ rng.uniform(0.2, 1.0, SINES)
    course *= FARTHEST * rng.uniform(0.4, 1.0) / np.abs(course).max()
    return course, float(course[0])


def draw_moves(kind: str, times: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, float]:
    """Return moves of one profile from target to target [rad], and where the first begins."""
    place = pose = float(rng.uniform(-FARTHEST, FARTHEST))
    course, begin = np.empty_like(times), 0.0
    while begin <= times[-1]:
        lasts, target = rng.uniform(*LASTS), float(rng.uniform(-FARTHEST, FARTHEST))
        time = np.clip((times - begin) / (lasts * rng.uniform(*MOVING)), 0, 1)
        course = np.where(times >= begin, place + (target - place) * PROFILES[kind](time), course)
        place, begin = target, begin + lasts
    return course, pose
