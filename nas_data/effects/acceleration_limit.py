"""Limit of the acceleration with which a servo approaches its goal."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np

from nas_data.effects.base import Effect, Parameter, Scales
from nas_data.effects.edits.profile import limit_goal_acceleration
from nas_data.effects.edits.servo import (
    compute_control_per_speed,
    find_position_servo,
    find_speed_servo,
    is_velocity_servo,
    read_servo_damping,
)
from nas_data.errors import ModelFileError

SLEW = 7  # index of a dcmotor's slew rate in `dynprm`


@dataclass(frozen=True, kw_only=True)
class AccelerationLimit(Effect):
    """The servo's goal speeds up and brakes at this rate at most; the servo follows that goal.

    A step becomes a triangle of speed; with `speed_limit` a trapezoid. The command of a velocity servo becomes a ramp.
    The model of a position servo has the goal joint of a servo with a dead band (see `Deadband`), but it is heavy and
    moved by a limited force. The goal follows a moving command 3 ms late, or 1.4 physics steps if they exceed 2 ms.
    """

    acceleration: float

    parameters: ClassVar = (Parameter("acceleration", "rad/s²", 0.01, 1000.0, math.inf),)
    edit_order: ClassVar = 2
    equation: ClassVar = (
        "|d²goal/dt²| ≤ acceleration, the goal stops at the command, torque = servo(goal − q); of a velocity command, "
        "|d goal/dt| ≤ acceleration"
    )
    source: ClassVar = "Feetech STS3215, Acceleration (register 41); Dynamixel X, Profile Acceleration (register 108)"
    signature: ClassVar = (
        "After every step the joint starts and stops along a parabola; twice the move takes 1.4 times as long."
    )
    confused_with: ClassVar = ("speed_limit", "rotor_inertia", "torque_limit", "command_delay")

    @classmethod
    def guesses(cls, scales: Scales) -> tuple[Mapping[str, float], ...]:
        """Accelerations that reach the measured speed within two, two thirds and a fifth of a radian of travel."""
        return tuple({"acceleration": share * scales.speed**2 / scales.radian} for share in (0.25, 0.75, 2.5))

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Limit the acceleration of the goal of the joint's servo; of two limits the lower one holds.

        Raises:
            ModelFileError: no position or velocity servo drives the joint, or a position servo has an integral gain, or
                a velocity servo has other dynamics.
        """
        assert self.joint is not None
        if self.acceleration * spec.option.timestep**2 > 1:
            return  # any goal is reached within one physics step
        if is_velocity_servo(spec, self.joint):
            self._limit_slope(spec)
            return
        servo = find_position_servo(spec, self.joint, self.name())
        limit_goal_acceleration(spec, self.joint, servo, self.acceleration)

    def _limit_slope(self, spec: mujoco.MjSpec) -> None:
        """Turn a velocity servo into a `<dcmotor>` of the same gain with a slew rate of its command."""
        assert self.joint is not None
        servo = find_speed_servo(spec, self.joint)
        assert servo is not None
        slope = self.acceleration * abs(float(servo.gear[0]))
        if servo.dyntype == mujoco.mjtDyn.mjDYN_DCMOTOR:
            parameters = servo.dynprm.copy()
            parameters[SLEW] = min(slope, parameters[SLEW]) if parameters[SLEW] > 0 else slope
            servo.dynprm = parameters
            return
        if servo.dyntype != mujoco.mjtDyn.mjDYN_NONE or servo.biasprm[0]:
            raise ModelFileError(
                f"{self.name()} cannot be added to the actuator '{servo.name}', which filters its command or adds a "
                "constant force."
            )
        gear = float(servo.gear[0])
        gain, unit = read_servo_damping(spec, self.joint) / gear**2, compute_control_per_speed(servo) / gear
        is_pid, limits = servo.gaintype == mujoco.mjtGain.mjGAIN_PID, (servo.forcelimited, servo.forcerange.copy())
        limited = servo.ctrllimited
        span = np.sort((servo.velrange if is_pid else servo.ctrlrange) / unit)
        servo.set_to_dcmotor(
            motorconst=[1.0, 0.0],
            resistance=1.0,
            controller=[0.0, 0.0, gain, slope, 0.0, 0.0],
            ctrlspec=int(mujoco.mjtCtrlInput.mjINPUT_VEL),
        )
        servo.forcelimited, servo.forcerange = limits
        servo.ctrlrange, servo.velrange = span, np.zeros(2)
        servo.ctrllimited = mujoco.mjtLimited.mjLIMITED_AUTO if is_pid else limited
