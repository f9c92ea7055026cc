"""Command signals: the paper's steps, triangles and sweeps; point-to-point moves and sines for other arms."""

from collections.abc import Callable, Mapping

import numpy as np

from nas_data.benchmarks.blind.case import Conditions
from nas_data.excitations.base import Excitation
from nas_data.excitations.chirp import Chirp
from nas_data.excitations.multisine import Multisine
from nas_data.excitations.steps import Steps
from nas_data.excitations.triangle import Triangle

RESET_SHARE = 0.2  # share of the range in which the paper's resets draw a pose
SHARE = 0.8  # share of the range that steps use: with overshoot, links stay within ±90°


def draw_episodes(
    conditions: Conditions, episodes: int, control: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Draw the commands of a set of episodes, in random order.

    Args:
        conditions: Rate and length; the signal is `steps`, or `mixed`, half of which are triangles and sweeps.
        episodes: Number of episodes E.
        control: Lowest and highest command of each joint [rad], shape (n, 2).
        rng: Source of randomness.

    Returns:
        Commands (E, T, n) and the poses held before (E, n), rounded to single precision as stored.
    """
    kinds = [(kind, count) for kind, count in divide_episodes(conditions.signal, episodes, rng) if count]
    parts = [draw_part(kind, conditions, (count, control), rng) for kind, count in kinds]
    commands, poses = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    order = rng.permutation(episodes)
    return as_stored(commands[order]), as_stored(poses[order])


def divide_episodes(signal: str, episodes: int, rng: np.random.Generator) -> list[tuple[Excitation, int]]:
    """Return the number of episodes of each excitation."""
    steps = Steps(share=SHARE)
    if signal == "steps":
        return [(steps, episodes)]
    quarter = episodes // 4
    sweep = Multisine(slowest=0.3, share=0.6) if rng.random() < 0.5 else Chirp(fastest=2.5, share=0.4)
    return [(steps, episodes - 2 * quarter), (Triangle(), quarter), (sweep, quarter)]


def draw_part(
    kind: Excitation, conditions: Conditions, size: tuple[int, np.ndarray], rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Return commands and poses of one excitation; poses are the first command, except for steps."""
    episodes, control = size
    low, high = control.T
    commands = kind.commands(rng, episodes, conditions.steps, conditions.period, low, high)
    middle, half = (low + high) / 2, (high - low) / 2
    poses = middle + RESET_SHARE * half * rng.uniform(-1, 1, (episodes, len(low)))
    return commands, poses if isinstance(kind, Steps) else commands[:, 0].copy()


def as_stored(values: np.ndarray) -> np.ndarray:
    """Round to single precision, so that the played commands equal the stored ones exactly."""
    return values.astype(np.float32).astype(float)


MIXTURE = "mixture"
FARTHEST = 0.9  # [rad] from zero: with overshoot, links stay within ±90°
LASTS = (0.4, 1.5)  # [s] duration of a step or a move
MOVING = (0.5, 1.0)  # share of the duration in motion; the rest is standstill
SINES, FREQUENCIES = 3, (0.15, 1.5)  # number of sines and their frequencies [Hz]

# time as a share of a move's duration → share of its distance; minimum jerk as in Flash and Hogan, J. Neurosci. 5
# (1985) 1688
PROFILES: Mapping[str, Callable[[np.ndarray], np.ndarray]] = {
    "steps": np.ones_like,
    "ramps": lambda time: time,
    "minimum_jerk": lambda time: time**3 * (10 - 15 * time + 6 * time**2),
}
SIGNALS = (*PROFILES, "sines", MIXTURE)


def draw_motions(
    conditions: Conditions, episodes: int, control: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Draw the commands of a set of episodes.

    Args:
        conditions: Rate and length; the signal is one of `SIGNALS`; a mixture draws one per episode.
        episodes: Number of episodes E.
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
    """Return a sum of sines [rad], shape (T,), scaled to a drawn amplitude, and its first value."""
    phases = 2 * np.pi * (np.outer(times, rng.uniform(*FREQUENCIES, SINES)) + rng.random(SINES))
    course = np.sin(phases) @ rng.uniform(0.2, 1.0, SINES)
    course *= FARTHEST * rng.uniform(0.4, 1.0) / np.abs(course).max()
    return course, float(course[0])


def draw_moves(kind: str, times: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, float]:
    """Return moves of one profile from target to target [rad], shape (T,), and the first value."""
    place = pose = float(rng.uniform(-FARTHEST, FARTHEST))
    course, begin = np.empty_like(times), 0.0
    while begin <= times[-1]:
        lasts, target = rng.uniform(*LASTS), float(rng.uniform(-FARTHEST, FARTHEST))
        time = np.clip((times - begin) / (lasts * rng.uniform(*MOVING)), 0, 1)
        course = np.where(times >= begin, place + (target - place) * PROFILES[kind](time), course)
        place, begin = target, begin + lasts
    return course, pose
