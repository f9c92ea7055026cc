"""Integral part of a servo's position loop."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np

from nas_data.effects.base import Effect, Parameter, Scales
from nas_data.effects.edits.servo import (
    POSITION_INPUT,
    find_position_servo,
    has_own_zero,
    read_force_range,
    read_position_feedback,
    take_own_unit,
)
from nas_data.errors import ModelFileError
from nas_data.mjcf.actuator_lookup import BAND, PROFILE


@dataclass(frozen=True, kw_only=True)
class IntegralGain(Effect):
    """The servo also integrates its position error, in addition to an integral gain of the model.

    An arm at rest starts with the integral that holds its weight (see `simulators/integrals.py`). The integral's own
    torque is at most the torque limit of the actuator, so that it does not wind up further in saturation. It removes
    any constant error, also that of a `joint_offset`.
    """

    gain: float

    parameters: ClassVar = (Parameter("gain", "N·m/(rad·s)", 0.0, 1e5, 0.0),)
    edit_order: ClassVar = 1  # after a torque limit
    equation: ClassVar = "torque = kp · e + gain · ∫ e dt − kv · dq/dt, e = command − q, |gain · ∫ e dt| ≤ torque limit"
    source: ClassVar = "MuJoCo 4.0 <pid ki imax>; Robotis e-manual of XL-320, I gain (register 28)"
    signature: ClassVar = "A droop or lag that decays within a second after each move, and overshoot after big steps."
    confused_with: ClassVar = ("servo_stiffness", "gravity_compensation", "joint_offset")

    @classmethod
    def guesses(cls, scales: Scales) -> tuple[Mapping[str, float], ...]:
        """Gains that remove an error within three seconds to a fifth of a second."""
        return tuple({"gain": rate * scales.stiffness} for rate in (0.3, 1.5, 5.0))

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Turn the position servo into a `<pid>` of the same gains, or take the one that it is, and add to its `ki`.

        Raises:
            ModelFileError: no position servo drives the joint, it filters its command, has a dead band, or its control
                has a zero of its own, which the integral would ignore.
        """
        assert self.joint is not None
        servo = find_position_servo(spec, self.joint, self.name())
        if reason := self._find_obstacle(spec, servo):
            raise ModelFileError(f"integral_gain cannot be added to the actuator '{servo.name}', which {reason}.")
        if servo.gaintype != mujoco.mjtGain.mjGAIN_PID:
            take_own_unit(spec, self.joint, servo)
            bias = servo.biasprm.copy()
            servo.set_to_pid(kp=read_position_feedback(servo), kv=-float(bias[2]), ctrlspec=POSITION_INPUT)
            servo.biasprm = bias  # set_to_pid drops a constant bias
        gain = servo.gainprm.copy()
        gain[0] += self.gain / float(servo.gear[0]) ** 2
        servo.gainprm = gain
        dynamics = servo.dynprm.copy() if servo.dyntype == mujoco.mjtDyn.mjDYN_PID else np.zeros_like(servo.dynprm)
        limits = read_force_range(servo)
        dynamics[0] = 0.0 if limits is None else max(map(abs, limits)) / gain[0]
        servo.dyntype, servo.dynprm = mujoco.mjtDyn.mjDYN_PID, dynamics

    def _find_obstacle(self, spec: mujoco.MjSpec, servo: mujoco.MjsActuator) -> str:
        """Return why a servo cannot have an integral part, as the end of a sentence; empty if it can."""
        if servo.dyntype not in (mujoco.mjtDyn.mjDYN_NONE, mujoco.mjtDyn.mjDYN_PID):
            return "filters its command already"
        if spec.actuator(f"{self.joint}{BAND}") is not None:
            return "has a dead band that the integral would overcome"
        if spec.actuator(f"{self.joint}{PROFILE}") is not None:
            return "moves a goal joint with a profile, whose error the integral would sum up"
        if has_own_zero(spec, str(self.joint), servo):
            return "takes a control with a zero of its own; give a model that is commanded positions"
        return ""
