"""Train φ: the measured next state minus the source's prediction."""

from dataclasses import dataclass
from typing import ClassVar, Literal

from nas_data.commands._training import Train


@dataclass(frozen=True, kw_only=True)
class TrainDelta(Train):
    """Train the delta model φ on a paired dataset.

    Example: nas train delta datasets/arm --out runs/phi
    """

    kind: ClassVar[Literal["delta", "forward"]] = "delta"
