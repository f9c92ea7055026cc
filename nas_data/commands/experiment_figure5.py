"""The paper's figure 5: return on the target of every method, over environments and seeds."""

from dataclasses import dataclass
from typing import ClassVar

from nas_data.commands._experiment import MethodsExperimentCommand


@dataclass(frozen=True, kw_only=True)
class ExperimentFigure5(MethodsExperimentCommand):
    """Record, train φ and ψ, name effects, train policies of every method and evaluate them on the target; resumable.

    Methods: expert (trained on the target), source, forward (ψ), nas (source + φ), named (source + the effects that
    `nas gap` names), named_nas, randomised (domain randomisation).

    Example: nas experiment figure5 --env Pusher --workers 2

    Example: nas experiment figure5 --env Pusher ErgoReacher --dynamics paper --methods expert source forward nas
    """

    experiment: ClassVar[str] = "figure5"
