"""Changes of a servo's goal by registers whose values are in SI: speed, acceleration, dead zone and least output."""

import math
from dataclasses import dataclass

import mujoco

from nas_data.effects.acceleration_limit import AccelerationLimit
from nas_data.effects.base import find_joint_actuator
from nas_data.effects.edits.band import replace_band
from nas_data.effects.edits.integral import SLEW, drop_unused_memory, has_integral
from nas_data.effects.edits.profile import limit_goal_acceleration
from nas_data.effects.edits.servo import (
    find_position_servo,
    is_position_controlled,
    read_band,
    read_position_feedback,
    read_torque_limit,
)
from nas_data.effects.speed_limit import SpeedLimit
from nas_data.mjcf.actuator_lookup import DRIVE, GOAL_GAIN, ON_JOINT, PROFILE
from nas_data.simulators.register_changes import RegisterChange, Setting

FASTEST = SpeedLimit.parameters[0].high  # [rad/s] a limit above it is none
STEEPEST = AccelerationLimit.parameters[0].high  # [rad/s²] a limit above it is none
ZERO = 1e-9  # [rad; N·m] dead zone or torque below which there is none: they are differences of rounded numbers


@dataclass(frozen=True)
class GoalSpeed(RegisterChange):
    """Limit of the speed of the servo's goal; 0 for none.

    Attributes:
        unit: Unit of the register [rad/s].
        bits: Part of the register that is the speed.
    """

    unit: float
    bits: int

    def decode(self, value: float) -> float:
        """Return the limit of a register value [rad/s]; 0 for none."""
        speed = (abs(int(value)) & self.bits) * self.unit
        return speed if speed <= FASTEST else 0.0

    def is_in(self, spec: mujoco.MjSpec, joint: str) -> bool:
        """Whether the servo has a slew rate."""
        servo = find_joint_actuator(spec, joint)
        return bool(servo.dyntype == mujoco.mjtDyn.mjDYN_PID and servo.dynprm[SLEW] > 0)

    def is_none(self, setting: Setting) -> bool:
        """Whether the speed is not limited."""
        return not self.decode(setting.value)

    def find_obstacle(self, setting: Setting) -> str:
        """Return why the servo's goal has no speed that could be limited."""
        servo = find_joint_actuator(setting.spec, setting.joint)
        if servo.dyntype not in (mujoco.mjtDyn.mjDYN_NONE, mujoco.mjtDyn.mjDYN_PID):
            return "the model's servo filters its command"
        return find_goal_obstacle(setting.spec, setting.joint)

    def edit(self, setting: Setting) -> None:
        """Set the slew rate of the servo."""
        servo = find_position_servo(setting.spec, setting.joint, "The speed of the goal")
        if servo.dyntype == mujoco.mjtDyn.mjDYN_PID:
            parameters = servo.dynprm.copy()
            parameters[SLEW] = 0.0  # of two limits the lower one would hold
            servo.dynprm = parameters
            drop_unused_memory(servo)
        if speed := self.decode(setting.value):
            SpeedLimit(joint=setting.joint, speed=speed).edit(setting.spec)

    def describe(self, setting: Setting) -> str:
        """Return the limit in words."""
        speed = self.decode(setting.value)
        return f"the speed of the goal is {f'limited to {speed:.3g} rad/s' if speed else 'not limited'}"


@dataclass(frozen=True)
class GoalAcceleration(RegisterChange):
    """Limit of the acceleration of the servo's goal; 0 for none.

    Attributes:
        unit: Unit of the register [rad/s²].
    """

    unit: float

    def decode(self, value: float) -> float:
        """Return the limit of a register value [rad/s²]; 0 for none."""
        acceleration = value * self.unit
        return acceleration if acceleration <= STEEPEST else 0.0

    def is_in(self, spec: mujoco.MjSpec, joint: str) -> bool:
        """Whether the servo's goal has a profile."""
        return spec.actuator(joint + PROFILE) is not None

    def is_none(self, setting: Setting) -> bool:
        """Whether the acceleration is not limited."""
        return not self.decode(setting.value)

    def find_obstacle(self, setting: Setting) -> str:
        """Return why the servo's goal can have no profile."""
        return find_goal_obstacle(setting.spec, setting.joint) or find_integral_obstacle(setting)

    def edit(self, setting: Setting) -> None:
        """Set the profile of the goal; one that is switched off stays, with an acceleration that limits nothing."""
        acceleration, spec, joint = self.decode(setting.value), setting.spec, setting.joint
        if self.is_in(spec, joint):
            spec.delete(spec.actuator(joint + PROFILE))  # of two limits the lower one would hold
        elif not acceleration:
            return
        servo = find_position_servo(spec, joint, "The acceleration of the goal")
        limit_goal_acceleration(spec, joint, servo, acceleration or STEEPEST)

    def describe(self, setting: Setting) -> str:
        """Return the limit in words."""
        acceleration = self.decode(setting.value)
        limit = f"limited to {acceleration:.3g} rad/s²" if acceleration else "not limited"
        return f"the acceleration of the goal is {limit}"


@dataclass(frozen=True)
class DeadZone(RegisterChange):
    """Position error that the servo ignores.

    Attributes:
        unit: Unit of the register [rad].
    """

    unit: float

    def is_in(self, spec: mujoco.MjSpec, joint: str) -> bool:
        """Whether the servo has a dead band."""
        return read_goal_band(spec, joint)[0] > ZERO

    def find_obstacle(self, setting: Setting) -> str:
        """Return why the servo can have no dead band."""
        return find_goal_obstacle(setting.spec, setting.joint) or find_integral_obstacle(setting)

    def edit(self, setting: Setting) -> None:
        """Set the half width of the servo's dead band; its start torque stays."""
        _, torque = read_goal_band(setting.spec, setting.joint)
        servo = find_position_servo(setting.spec, setting.joint, "The dead zone")
        replace_band(setting.spec, setting.joint, servo, (setting.value * self.unit, torque))

    def describe(self, setting: Setting) -> str:
        """Return the half width in words."""
        return f"the dead zone is ±{setting.value * self.unit:.3g} rad"


@dataclass(frozen=True)
class LeastOutput(RegisterChange):
    """Least torque that the servo gives, a share of its full torque.

    Attributes:
        full: Value of this register, and of that of the torque limit, at full torque.
    """

    full: float

    def is_in(self, spec: mujoco.MjSpec, joint: str) -> bool:
        """Whether the servo has a start torque."""
        return read_goal_band(spec, joint)[1] > ZERO

    def find_obstacle(self, setting: Setting) -> str:
        """Return why the servo can have no start torque."""
        if not math.isfinite(read_torque_limit(setting.spec, setting.joint)):
            return "the model's servo has no torque limit, of which the register is a share"
        return find_goal_obstacle(setting.spec, setting.joint) or find_integral_obstacle(setting)

    def edit(self, setting: Setting) -> None:
        """Set the servo's start torque; its dead band stays."""
        half_width, _ = read_goal_band(setting.spec, setting.joint)
        servo = find_position_servo(setting.spec, setting.joint, "The least output")
        replace_band(setting.spec, setting.joint, servo, (half_width, self._compute_torque(setting)))

    def describe(self, setting: Setting) -> str:
        """Return the torque in words."""
        return f"the least output is {self._compute_torque(setting):.3g} N·m"

    def _compute_torque(self, setting: Setting) -> float:
        """Return the least torque [N·m].

        The model's torque limit belongs to its own register of the torque limit, in the same unit; without one it is
        the full torque.
        """
        share = setting.value / (setting.torque_limit or self.full)
        return share * read_torque_limit(setting.spec, setting.joint)


def read_goal_band(spec: mujoco.MjSpec, joint: str) -> tuple[float, float]:
    """Return the half width of a servo's dead band [rad] and its start torque [N·m]; 0 for none."""
    return read_band(spec, joint) if spec.actuator(joint + GOAL_GAIN) is not None else (0.0, 0.0)


def find_goal_obstacle(spec: mujoco.MjSpec, joint: str) -> str:
    """Return why a joint's actuator has no goal with the unit of the servo's; empty if it has one."""
    servo = find_joint_actuator(spec, joint)
    if read_position_feedback(servo) <= 0 or not is_position_controlled(servo):
        return "the model's actuator is no position servo"
    if spec.joint(joint).type != mujoco.mjtJoint.mjJNT_HINGE:
        return "the travel of a slide per turn of its servo is unknown"
    if servo.trntype not in ON_JOINT and servo.target != joint + DRIVE:
        return "the model's servo does not act on the joint alone"
    return ""


def find_integral_obstacle(setting: Setting) -> str:
    """Return why the servo can have no goal joint, on which dead band, start torque and profile act."""
    return "the model's servo has an integral gain" if has_integral(setting.spec, setting.joint) else ""
