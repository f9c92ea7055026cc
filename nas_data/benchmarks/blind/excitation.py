"""The command signals of a case: the paper's steps, or half steps, a quarter slow triangles, a quarter sweeps."""

import numpy as np

from nas_data.benchmarks.blind.conditions import Conditions
from nas_data.excitations.base import Excitation
from nas_data.excitations.chirp import Chirp
from nas_data.excitations.multisine import Multisine
from nas_data.excitations.steps import Steps
from nas_data.excitations.triangle import Triangle

SIGNALS = ("steps", "mixed")
RESET_SHARE = 0.2  # part of the range in which the paper's resets draw a pose
SHARE = 0.8  # part of the range that steps use: overshoot stays within a turn's quarter


def draw_episodes(
    conditions: Conditions, episodes: int, control: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Draw one set of episodes, in random order.

    Args:
        conditions: Rate and length; the signal is one of `SIGNALS`.
        episodes: How many.
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
    """Return how many episodes each excitation gets."""
    steps = Steps(share=SHARE)
    if signal == "steps":
        return [(steps, episodes)]
    quarter = episodes // 4
    sweep = Multisine(slowest=0.3, share=0.6) if rng.random() < 0.5 else Chirp(fastest=2.5, share=0.4)
    return [(steps, episodes - 2 * quarter), (Triangle(), quarter), (sweep, quarter)]


def draw_part(
    kind: Excitation, conditions: Conditions, size: tuple[int, np.ndarray], rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Return so many commands of such a range, and poses, of one excitation; all but steps start at their signal's."""
    episodes, control = size
    low, high = control.T
    commands = kind.commands(rng, episodes, conditions.steps, conditions.period, low, high)
    middle, half = (low + high) / 2, (high - low) / 2
    poses = middle + RESET_SHARE * half * rng.uniform(-1, 1, (episodes, len(low)))
    return commands, poses if isinstance(kind, Steps) else commands[:, 0].copy()


def as_stored(values: np.ndarray) -> np.ndarray:
    """Round to single precision: what is played is to the bit what the dataset says was played."""
    return values.astype(np.float32).astype(float)
