"""The paper's figure 4: one command sequence on the target, with the predictions of φ, ψ, source and hold."""

from dataclasses import dataclass
from typing import ClassVar

from nas_data.commands._experiment import ExperimentCommand


@dataclass(frozen=True, kw_only=True)
class ExperimentFigure4(ExperimentCommand):
    """Record, pair, train φ and ψ, and predict a held-out sequence in open loop: figures and errors over time.

    Example: nas experiment figure4

    Example: nas experiment figure4 --env ErgoReacher --dynamics paper --quick
    """

    experiment: ClassVar[str] = "figure4"
