"""What a baseline answers: names with a confidence, and a prediction of episodes it has not seen."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from nas_data import registry
from nas_data.benchmarks.blind.findings import ReportedEffect
from nas_data.benchmarks.blind.fresh import Predict


@dataclass(frozen=True)
class Claim:
    """A baseline's answer."""

    findings: tuple[ReportedEffect, ...]  # effects it names; empty where it names none
    predict: Predict  # commands (E, T, n), first positions and speeds (E, 2n) → positions (E, T, n) [rad]


def claim(effect: str, joint: str | None) -> ReportedEffect:
    """Return a name without parameters; a method without a measure of doubt is sure of it."""
    return ReportedEffect((effect, joint), {}, {}, 1.0, ())


def find_baseline(name: str) -> Callable[[Path, Path], Claim]:
    """Return what answers for a dataset and a nominal model.

    Raises:
        UnknownName: there is no such baseline; lists those there are.
    """
    answer: Callable[[Path, Path], Claim] = registry.import_plugin(
        "benchmarks.blind.baselines", name, "baseline"
    ).answer
    return answer
