"""Train ψ: the next state from state and command alone."""

from dataclasses import dataclass
from typing import ClassVar, Literal

from nas_data.commands._training import Train


@dataclass(frozen=True, kw_only=True)
class TrainForward(Train):
    """Train the forward model ψ, which needs no simulator.

    Example: nas train forward datasets/arm --out runs/psi
    """

    kind: ClassVar[Literal["delta", "forward"]] = "forward"
