"""Input of a baseline (episodes of a dataset) and its answer: names with a confidence, and a prediction."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from nas_data import registry
from nas_data.benchmarks.blind.fresh import Predict
from nas_data.benchmarks.blind.grade import ReportedEffect
from nas_data.dataset.read import read


@dataclass(frozen=True)
class RecordedCase:
    """Episodes of a dataset."""

    joints: tuple[str, ...]  # names of the measured joints
    rate: float  # control rate [Hz]
    commands: np.ndarray  # [rad, N m], shape (E, T, n)
    states: np.ndarray  # positions [rad] then velocities [rad/s] before each command and after the last, (E, T + 1, 2n)

    @classmethod
    def load(cls, folder: Path) -> "RecordedCase":
        """Read a dataset whose episodes are equally long, as blind cases are."""
        dataset = read(folder)
        rows = list(dataset.episodes())
        before = np.stack([dataset.states[row] for row in rows]).astype(float)
        last = np.stack([dataset.next_states[row][-1:] for row in rows]).astype(float)
        commands = np.stack([dataset.commands[row] for row in rows]).astype(float)
        return cls(dataset.joints, dataset.fps, commands, np.concatenate([before, last], axis=1))

    @property
    def positions(self) -> np.ndarray:
        """Measured positions [rad], shape (E, T + 1, n)."""
        return self.states[..., : len(self.joints)]


@dataclass(frozen=True)
class Claim:
    """A baseline's answer."""

    findings: tuple[ReportedEffect, ...]  # named effects
    predict: Predict  # commands (E, T, n), first positions and speeds (E, 2n) → positions (E, T, n) [rad]


def claim(effect: str, joint: str | None) -> ReportedEffect:
    """Return a name without parameters, at full confidence."""
    return ReportedEffect((effect, joint), {}, {}, 1.0, ())


def find_baseline(name: str) -> Callable[[Path, Path], Claim]:
    """Return a baseline's function, (dataset, nominal model) → claim.

    Raises:
        UnknownName: there is no such baseline; lists the baselines.
    """
    answer: Callable[[Path, Path], Claim] = registry.import_plugin(
        "benchmarks.blind.baselines", name, "baseline"
    ).answer
    return answer
