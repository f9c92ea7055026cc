"""Limit of the speed at which a servo approaches its goal."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import mujoco

from nas_data.effects.base import Effect, Parameter, Scales
from nas_data.effects.edits.servo import (
    POSITION_INPUT,
    compute_control_per_speed,
    find_position_servo,
    find_speed_servo,
    read_position_feedback,
    take_own_unit,
)
from nas_data.errors import ModelFileError


@dataclass(frozen=True, kw_only=True)
class SpeedLimit(Effect):
    """Large steps become ramps of one slope; slower commands are unaffected.

    The target speed of a servo that is commanded a speed is clipped.
    """

    speed: float

    parameters: ClassVar = (Parameter("speed", "rad/s", 0.001, 30.0, math.inf),)
    equation: ClassVar = "|d goal/dt| ≤ speed, torque = servo(goal − q); of a velocity command, |command| ≤ speed"
    source: ClassVar = "MuJoCo 4.0 <pid slewmax>; XL-320 e-manual, Moving Speed (register 32)"
    signature: ClassVar = "Straight ramps of the same slope after every big step, nothing on slow moves, at any load."
    confused_with: ClassVar = ("torque_limit", "viscous_friction", "command_delay", "acceleration_limit")

    @classmethod
    def guesses(cls, scales: Scales) -> tuple[Mapping[str, float], ...]:
        """Below and slightly above the measured speed."""
        return tuple({"speed": share * scales.speed} for share in (0.4, 0.8, 1.2))

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Turn the position servo into a `<pid>` of the same gains with a slew rate; of two limits the lower one holds.

        A servo that is commanded a speed gets a control range.

        Raises:
            ModelFileError: no servo drives the joint, or its command is filtered.
        """
        assert self.joint is not None
        if (follower := find_speed_servo(spec, self.joint)) is not None:
            self._limit_control(follower)
            return
        servo = find_position_servo(spec, self.joint, self.name())
        if servo.dyntype == mujoco.mjtDyn.mjDYN_PID:
            self._limit_pid(servo)
            return
        if servo.dyntype != mujoco.mjtDyn.mjDYN_NONE:
            raise ModelFileError(
                f"speed_limit cannot be added to the actuator '{servo.name}', which filters its command already."
            )
        take_own_unit(spec, self.joint, servo)
        bias = servo.biasprm.copy()
        slewmax = self.speed * abs(float(servo.gear[0]))
        servo.set_to_pid(kp=read_position_feedback(servo), kv=-float(bias[2]), slewmax=slewmax, ctrlspec=POSITION_INPUT)
        servo.biasprm = bias  # set_to_pid drops a constant bias

    def _limit_control(self, servo: mujoco.MjsActuator) -> None:
        """Limit the control of a servo that is commanded a speed; a narrower range stays."""
        most, is_pid = self.speed * abs(compute_control_per_speed(servo)), servo.gaintype == mujoco.mjtGain.mjGAIN_PID
        low, high = servo.velrange if is_pid else servo.ctrlrange
        if low == high == 0 or (not is_pid and servo.ctrllimited == mujoco.mjtLimited.mjLIMITED_FALSE):
            low, high = -most, most
        limits = [max(low, -most), min(high, most)]
        if is_pid:
            servo.velrange = limits
        else:
            servo.ctrllimited, servo.ctrlrange = mujoco.mjtLimited.mjLIMITED_TRUE, limits

    def _limit_pid(self, servo: mujoco.MjsActuator) -> None:
        """Set the slew rate of a `<pid>` servo, or lower an existing one."""
        parameters = servo.dynprm.copy()
        present, limit = float(parameters[1]), self.speed * abs(float(servo.gear[0]))
        parameters[1] = min(limit, present) if present > 0 else limit
        servo.dynprm = parameters
