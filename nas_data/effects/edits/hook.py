"""What an effect that the engine lacks sees and changes between two physics steps."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np


@dataclass(frozen=True)
class StepForces:
    """Forces in B simulations of one model, live.

    Attributes:
        force: What each actuator gave in the last step [N·m], shape (B, outputs); to be read.
        bias: What weight and motion asked of each joint in the last step [N·m], shape (B, nv); to be read.
        released: Whether the servos are switched off, shape (B,); to be read.
        friction: What opposes motion in the next step [N·m], shape (B, nv): the model's own, to which hooks add.
    """

    force: np.ndarray
    bias: np.ndarray
    released: np.ndarray
    friction: np.ndarray


StepHook: TypeAlias = Callable[[StepForces], None]
