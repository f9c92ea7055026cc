"""Sweeps of a few short trainings on the pendulum."""

import json
from dataclasses import replace
from pathlib import Path

from support.command_samples import Place

from nas_data.models.presets import preset
from nas_data.studies.ablation import trial as trials
from nas_data.studies.ablation.sweep import SweepPlan
from nas_data.studies.ablation.sweep_data import Amount, SweepData

BRIEF = ("--hidden", "8", "--updates", "2", "--horizon", "20")
TINY = preset("fast", hidden=8, layers=1, updates=2, horizon=20, frames=100)
CIRCUMSTANCES = {"wall_seconds", "cpu_seconds", "packages", "commit"}


def plan(place: Place, **changes) -> SweepPlan:
    """Return a sweep of six trials on the pendulum."""
    material = SweepData(place.paired)
    kinds, amounts = ("delta", "forward"), (Amount(2, "episodes"), Amount(4, "episodes"), Amount(6, "episodes"))
    return replace(SweepPlan(kinds, amounts, (0,), TINY, 0.2, material), **changes)


def planned(place: Place, folder: Path, **changes) -> list[trials.Trial]:
    swept = plan(place, **changes)
    return swept.trials(swept.material.content(), folder)


def silent(_: str) -> None:
    """Say nothing."""


def answers(folder: Path) -> dict[str, dict]:
    """Return the results of a sweep's trials by their key, without what differs from run to run."""
    found = {path.stem: json.loads(path.read_text()) for path in (folder / "trials").glob("*.json")}
    return {key: {k: v for k, v in record.items() if k not in CIRCUMSTANCES} for key, record in found.items()}
