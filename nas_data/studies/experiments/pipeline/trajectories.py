"""φ, ψ and what needs no learning, compared on the same episodes."""

from collections.abc import Mapping
from pathlib import Path
from typing import TypeVar

from nas_data.dataset.dataset import Dataset
from nas_data.models import checkpoint
from nas_data.models.evaluation import MODEL, Evaluation, evaluate
from nas_data.simulators.base import Simulator

PREDICTORS = (MODEL["delta"], MODEL["forward"], "source", "hold", "command")  # learned models first
Kept = TypeVar("Kept")


def compare_models(dataset: Dataset, source: Simulator, delta: Path, forward: Path) -> Evaluation:
    """Return the errors of φ, ψ and the trivial baselines on a dataset.

    Args:
        dataset: Transitions.
        source: What φ corrects.
        delta: Checkpoint of φ.
        forward: Checkpoint of ψ.
    """
    phi, psi = (checkpoint.load_frozen(checkpoint.find_checkpoint(folder)) for folder in (delta, forward))
    first, second = evaluate(dataset, source, phi), evaluate(dataset, None, psi)
    return Evaluation(
        in_order(first.one_step, second.one_step),
        in_order(first.open_loop, second.open_loop),
        in_order(first.rollouts, second.rollouts),
        {**second.diverged, **first.diverged},
    )


def in_order(one: Mapping[str, Kept], other: Mapping[str, Kept]) -> dict[str, Kept]:
    """Return what two evaluations hold, in the order of tables."""
    both = {**other, **one}
    return {name: both[name] for name in PREDICTORS if name in both}
