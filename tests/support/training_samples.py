"""Trainings small enough for tests."""

import json
from collections.abc import Sequence
from pathlib import Path

import pytest
import torch
from support.recording_samples import pendulum

from nas_data.models.losses import Phase
from nas_data.models.lstm import DynamicsModel
from nas_data.models.presets import TrainingOptions
from nas_data.models.run import TrainingRun
from nas_data.models.training import ModelTraining

TINY = TrainingOptions(
    hidden=16, layers=1, epochs=3, batch=8, updates=0, frames=160, horizon=25, bf16=False, validation=0.1
)


def silent(_line: str) -> None:
    """Report to nobody."""


def train(dataset, folder: Path, kind="delta", options=TINY, report=silent, **more) -> DynamicsModel:
    """Train in a folder; with the pendulum as source where rollouts are asked for."""
    source = pendulum() if options.updates else None
    return TrainingRun(ModelTraining(kind, dataset, options, source, device="cpu", **more), folder, report).run()


def same(a: DynamicsModel, b: DynamicsModel) -> bool:
    """Whether two models are equal to the last bit."""
    mine, other = a.state_dict(), b.state_dict()
    return list(mine) == list(other) and all(torch.equal(mine[key], other[key]) for key in mine)


def check_gradients(phase: Phase, places: Sequence[tuple[torch.Tensor, tuple[int, ...]]]) -> None:
    """Compare some gradients of a loss, each a parameter and a place in it, with differences of the loss."""
    phase.loss(3).backward()
    for parameter, place in places:
        losses = []
        for change in (0.01, -0.01):
            with torch.no_grad():
                parameter[place] += change
                losses.append(float(phase.loss(3)))
                parameter[place] -= change
        assert float(parameter.grad[place]) == pytest.approx((losses[0] - losses[1]) / 0.02, rel=0.02)


def history(folder: Path) -> list[dict[str, float]]:
    """Return what was told of each validation."""
    return json.loads((folder / "history.json").read_text())
