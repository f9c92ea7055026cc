"""The paper's table 1: quartiles and mean of squared trajectory differences of source, ψ, source + φ and hold."""

from dataclasses import dataclass
from typing import ClassVar

from nas_data.commands._experiment import ExperimentCommand


@dataclass(frozen=True, kw_only=True)
class ExperimentTable1(ExperimentCommand):
    """Record, pair, train φ and ψ, and compare their open-loop trajectories with held-out ones.

    Example: nas experiment table1

    Example: nas experiment table1 --env Pusher --quick
    """

    experiment: ClassVar[str] = "table1"
