"""φ, ψ and the baselines, compared on the same episodes."""

from collections.abc import Mapping, Sequence
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
    phi, psi = (checkpoint.load_for_inference(checkpoint.find_checkpoint(folder)) for folder in (delta, forward))
    return combine(evaluate(dataset, source, phi), evaluate(dataset, None, psi), PREDICTORS)


def combine(one: Evaluation, other: Evaluation, order: Sequence[str]) -> Evaluation:
    """Return two evaluations on the same episodes as one, with its predictors in order; the first takes precedence."""

    def merge(first: Mapping[str, Kept], second: Mapping[str, Kept]) -> dict[str, Kept]:
        both = {**second, **first}
        return {name: both[name] for name in order if name in both}

    return Evaluation(
        merge(one.one_step, other.one_step),
        merge(one.open_loop, other.open_loop),
        merge(one.rollouts, other.rollouts),
        {**other.diverged, **one.diverged},
    )
