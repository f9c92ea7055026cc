"""The paper's figure 4: one command sequence on the target, and what φ, ψ, source and hold make of it."""

from dataclasses import dataclass
from typing import ClassVar

from nas_data.commands._experiment import ExperimentCommand


@dataclass(frozen=True, kw_only=True)
class ExperimentFigure4(ExperimentCommand):
    """Record, pair, learn φ and ψ, and predict a held-out sequence in open loop: pictures, errors over the rollout.

    Example: nas experiment figure4

    Example: nas experiment figure4 --env ErgoReacher --dynamics paper --quick
    """

    experiment: ClassVar[str] = "figure4"
