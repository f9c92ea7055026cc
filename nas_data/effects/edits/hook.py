"""Interface of hooks: functions that compute friction between physics steps, for effects that MuJoCo lacks."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np


@dataclass(frozen=True)
class StepForces:
    """Read-only views of forces and velocities in B simulations of one model.

    Attributes:
        force: Force of each actuator in the last step [N·m], shape (B, outputs).
        bias: Gravity, Coriolis and centrifugal torques in the last step (`qfrc_bias`) [N·m], shape (B, nv).
        velocity: Velocities (`qvel`) [rad/s; m/s], shape (B, nv).
        released: Whether the servos are switched off, shape (B,).
    """

    force: np.ndarray
    bias: np.ndarray
    velocity: np.ndarray
    released: np.ndarray


# A hook is called once with the forces and velocities of a batch. It returns the function that runs before each physics
# step. That function returns the friction to add to the model's in this step [N·m], shape (B, nv); it may reuse the
# array.
StepHook: TypeAlias = Callable[[StepForces], Callable[[], np.ndarray]]
