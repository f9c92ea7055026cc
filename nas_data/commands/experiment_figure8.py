"""The paper's figure 8: hits on ErgoShield of every method, and one joint's response to its command."""

from dataclasses import dataclass
from typing import ClassVar

from nas_data.commands._experiment import MethodsExperimentCommand


@dataclass(frozen=True, kw_only=True)
class ExperimentFigure8(MethodsExperimentCommand):
    """Train policies of every method on ErgoShield, count their hits on the target, plot one joint's response.

    Example: nas experiment figure8 --seeds 0 1 2 --workers 2

    Example: nas experiment figure8 --methods expert source forward nas --quick
    """

    experiment: ClassVar[str] = "figure8"
