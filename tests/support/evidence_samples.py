"""What an ErgoJr with noise and quantisation of XL-320 servos shows of itself, as evidence for the search."""

import numpy as np

from nas_data.effects.base import parse
from nas_data.gap.episode_batch import EpisodeBatch
from nas_data.gap.nominal import Nominal, with_timestep

JOINTS = ("m1", "m2", "m3", "m4", "m5", "m6")
QUANTUM = np.radians(0.29)


def commanded(episodes: int = 4, seconds: float = 1.5, seed: int = 0) -> EpisodeBatch:
    """Episodes of random targets held half a second, nothing measured yet."""
    rng = np.random.default_rng(seed)
    commands = rng.uniform(-0.7, 0.7, (episodes, round(2 * seconds), 6)).repeat(50, axis=1)
    empty = np.zeros_like(commands)
    counts = np.ones(commands.shape[:2], bool)
    return EpisodeBatch(JOINTS, 0.01, np.zeros((episodes, 6)), commands, empty, counts, np.arange(episodes))


def measured(
    effects: str = "", factors: dict[str, float] | None = None, seed: int = 0, timestep: float | None = None
) -> tuple[Nominal, EpisodeBatch]:
    """The ErgoJr and what a target with an effect measures, with noise and quantisation of an XL-320.

    The target takes the model's own physics steps unless a timestep is given [s].
    """
    evidence = commanded(seed=seed)
    nominal = Nominal.load("ergojr", evidence)
    hidden = [parse(effects)] if effects else []
    target = with_timestep(nominal, timestep) if timestep else nominal
    truth = target.predict(evidence, hidden, factors)
    noisy = truth + np.random.default_rng(seed + 1).normal(0, np.radians(0.05), truth.shape)
    rounded = np.round(noisy / QUANTUM) * QUANTUM
    parts = (evidence.initial_positions, evidence.commands, rounded, evidence.mask, evidence.numbers)
    return nominal, EpisodeBatch(JOINTS, 0.01, *parts)
