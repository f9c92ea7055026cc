"""Dead time between a command and its effect."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import mujoco

from nas_data.effects.base import Effect, Parameter, Scales
from nas_data.effects.edits.servo import find_actuators

LINEAR = 1  # linear interpolation between samples, for delays that are no multiple of the timestep


@dataclass(frozen=True, kw_only=True)
class CommandDelay(Effect):
    """Commands arrive late, at one joint or at all joints.

    MuJoCo delays by at least one physics timestep: a shorter delay acts like one timestep.
    """

    delay: float

    parameters: ClassVar = (Parameter("delay", "s", 0.0, 0.5, 0.0),)
    whole_arm: ClassVar = True
    stepwise: ClassVar = ("delay",)
    equation: ClassVar = "torque(t) = servo(command(t − delay) − q(t))"
    source: ClassVar = "MuJoCo documentation, Modeling, Delays"
    signature: ClassVar = "Every move starts late by the same time, whatever its size, speed or load."
    confused_with: ClassVar = ("rotor_inertia", "viscous_friction", "speed_limit")

    @classmethod
    def guesses(cls, scales: Scales) -> tuple[Mapping[str, float], ...]:
        """Ten to eighty milliseconds."""
        return tuple({"delay": delay} for delay in (0.01, 0.03, 0.08))

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Give the actuators a delay line; delays of the arm and of a joint add up."""
        for actuator in find_actuators(spec, self.joint):
            actuator.delay += self.delay
            # the additional sample makes the oldest one at least as old as the delay
            actuator.nsample = math.ceil(actuator.delay / spec.option.timestep) + 1
            actuator.interp = LINEAR
