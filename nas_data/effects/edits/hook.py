"""What an effect that the engine lacks sees between two physics steps."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np


@dataclass(frozen=True)
class StepForces:
    """Forces in B simulations of one model, live, to be read.

    Attributes:
        force: What each actuator gave in the last step [N·m], shape (B, outputs).
        bias: What weight and motion asked of each joint in the last step [N·m], shape (B, nv).
        released: Whether the servos are switched off, shape (B,).
    """

    force: np.ndarray
    bias: np.ndarray
    released: np.ndarray


# Given the forces of a batch once, returns what is called before each physics step: it returns the friction to add to
# the model's own in that step [N·m], shape (B, nv), in an array that it may use again for the next.
StepHook: TypeAlias = Callable[[StepForces], Callable[[], np.ndarray]]
