"""Table of the servo registers that change a model: their names in control tables, their units, what they set.

Sources: ROBOTIS e-manuals of the XL-320 and of the X series; Feetech's memory table of the STS series. The names of
Feetech's and of the X series' registers are LeRobot's (`motors/*/tables.py`).
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeAlias

import mujoco

from nas_data.effects.base import find_joint_actuator
from nas_data.effects.edits.integral import has_integral, scale_integral
from nas_data.effects.edits.servo import (
    is_position_controlled,
    read_position_feedback,
    read_servo_damping,
    scale_damping,
    scale_limit,
    scale_stiffness,
)
from nas_data.robots.ergojr import VELOCITY_QUANTUM
from nas_data.simulators.goal_registers import DeadZone, GoalAcceleration, GoalSpeed, LeastOutput
from nas_data.simulators.register_changes import RegisterChange, RegisterRatio, Unusable

P_GAIN, TORQUE, SUPPLY = "p_gain", "torque_limit", "supply_voltage"
SPEED_UNIT = VELOCITY_QUANTUM  # [rad/s] of the register moving_speed; XL-320 e-manual
STEP = 2 * math.pi / 4096  # [rad] of the STS3215's positions, speeds and dead zones; Feetech's memory table
STEEP_STEP = 100 * STEP  # [rad/s²] of the STS3215's acceleration; Feetech's memory table
HIGHEST_ACCELERATION = 254  # register of the STS3215
PROFILE_SPEED = 0.229 * 2 * math.pi / 60  # [rad/s], X series e-manual, Profile Velocity(112)
PROFILE_ACCELERATION = 214.577 * 2 * math.pi / 60**2  # [rad/s²], X series e-manual, Profile Acceleration(108)
TEN_BITS, FIFTEEN_BITS, ALL_BITS = 2**10 - 1, 2**15 - 1, 2**32 - 1  # without direction; directions are sign bits
TIME_BASED = 4  # bit of the X series' Drive_Mode for profiles whose registers are times
PROFILE = "Profile_Velocity"  # register that the X series alone has

Table: TypeAlias = Mapping[str, float]  # control table of a servo: value by register
Reader: TypeAlias = Callable[[Table], float | None]  # returns a register's value; None if the table lacks it


@dataclass(frozen=True)
class RegisterKind:
    """A register, or equivalent registers of several servos.

    Attributes:
        name: Name in models and reports.
        words: What it is.
        read: Function that reads its value from a control table.
        change: What it changes in a model.
        is_positive: Whether 0 is no setting of a moving servo.
        is_measured: Whether the servo measures it; models that do not state it are usual.
    """

    name: str
    words: str
    read: Reader
    change: RegisterChange
    is_positive: bool = False
    is_measured: bool = False


def read_lowest(*names: str) -> Reader:
    """Return a reader of the lowest register of those that a table has, because the lower of two limits holds."""
    return lambda table: min((table[name] for name in names if name in table), default=None)


def read_largest(*names: str) -> Reader:
    """Return a reader of the largest register of those that a table has."""
    return lambda table: max((table[name] for name in names if name in table), default=None)


def read_goal_velocity(table: Table) -> float | None:
    """Return the speed of an STS3215's goal; the X series uses this register only when it is commanded a speed."""
    value = None if PROFILE in table else read_lowest("Goal_Velocity", "Goal_Speed")(table)
    return None if value is None else abs(value)  # its sign is a direction


def read_acceleration(table: Table) -> float | None:
    """Return the acceleration of an STS3215's goal, at most the largest one.

    At 0 the servo uses its largest acceleration times an undocumented factor (register 86); that is taken for none. So
    is the highest setting, which LeRobot makes: 39 rad/s² of the goal would make a real SO-101 late after steps, which
    it is not.
    """
    if "Acceleration" not in table:
        return None
    limits = (table["Acceleration"], table.get("Maximum_Acceleration", 0.0))
    least = min((limit for limit in limits if limit), default=0.0)
    return least if table["Acceleration"] and least < HIGHEST_ACCELERATION else 0.0


def read_profile(name: str, is_time_based: bool = False) -> Reader:
    """Return a reader of a register of the X series' profile; 0 if the servo uses none.

    A profile is used if its speed is not 0; then an acceleration of 0 is infinite (X series e-manual, Profile
    Velocity(112)).

    Args:
        name: Name of the register.
        is_time_based: Whether to read profiles that are based on time; the others otherwise.
    """

    def read(table: Table) -> float | None:
        if name not in table or bool(int(table.get("Drive_Mode", 0)) & TIME_BASED) != is_time_based:
            return None
        return table[name] if table.get(PROFILE) else 0.0

    return read


def is_position_servo(spec: mujoco.MjSpec, joint: str) -> bool:
    """Whether a joint's actuator is commanded a position and feeds it back."""
    actuator = find_joint_actuator(spec, joint)
    return read_position_feedback(actuator) > 0 and is_position_controlled(actuator)


def scale_supply(spec: mujoco.MjSpec, joint: str, factor: float) -> None:
    """Multiply the supply voltage of a servo that sets the duty of its motor; its back-EMF, a damping, stays."""
    scale_stiffness(spec, joint, factor)
    scale_limit(spec, joint, factor)
    if has_integral(spec, joint):
        scale_integral(spec, joint, factor)


# In the order in which they change a model: a profile acts on a goal whose speed is limited already.
KINDS = {
    kind.name: kind
    for kind in (
        RegisterKind(
            name=P_GAIN,
            words="position gain",
            read=read_lowest(P_GAIN, "P_Coefficient", "Position_P_Gain"),
            change=RegisterRatio("position gain", scale_stiffness, is_position_servo),
            is_positive=True,
        ),
        RegisterKind(
            name="d_gain",
            words="derivative gain",
            read=read_lowest("d_gain", "D_Coefficient", "Position_D_Gain"),
            change=RegisterRatio(
                "velocity feedback", scale_damping, lambda spec, joint: read_servo_damping(spec, joint) > 0
            ),
        ),
        RegisterKind(
            name="i_gain",
            words="integral gain",
            read=read_lowest("i_gain", "I_Coefficient", "Position_I_Gain"),
            change=RegisterRatio("integral gain", scale_integral, has_integral),
        ),
        RegisterKind(
            name=TORQUE,
            words="torque limit",
            read=read_lowest(TORQUE, "max_torque", "Torque_Limit"),
            change=RegisterRatio("torque limit", scale_limit),
            is_positive=True,
        ),
        RegisterKind(
            name="moving_speed",
            words="speed of the goal",
            read=read_lowest("moving_speed"),
            change=GoalSpeed(SPEED_UNIT, TEN_BITS),
        ),
        RegisterKind(
            name="goal_velocity",
            words="speed of the goal",
            read=read_goal_velocity,
            change=GoalSpeed(STEP, FIFTEEN_BITS),
        ),
        RegisterKind(
            name="profile_velocity",
            words="speed of the goal",
            read=read_profile(PROFILE),
            change=GoalSpeed(PROFILE_SPEED, ALL_BITS),
        ),
        RegisterKind(
            name="profile_time",
            words="time of the profile",
            read=read_profile(PROFILE, is_time_based=True),
            change=Unusable("no model has a profile that is based on time (bit 2 of Drive_Mode)"),
        ),
        RegisterKind(
            name="goal_acceleration",
            words="acceleration of the goal",
            read=read_acceleration,
            change=GoalAcceleration(STEEP_STEP),
        ),
        RegisterKind(
            name="profile_acceleration",
            words="acceleration of the goal",
            read=read_profile("Profile_Acceleration"),
            change=GoalAcceleration(PROFILE_ACCELERATION),
        ),
        # The model's dead band is symmetric; of two zones the larger one bounds the error that the servo leaves.
        RegisterKind(
            name="dead_zone",
            words="dead zone",
            read=read_largest("CW_Dead_Zone", "CCW_Dead_Zone"),
            change=DeadZone(STEP),
        ),
        RegisterKind(
            name="punch", words="least output", read=read_lowest("punch"), change=LeastOutput(float(TEN_BITS))
        ),
        RegisterKind(
            name="minimum_startup_force",
            words="least output",
            read=read_lowest("Minimum_Startup_Force"),
            change=LeastOutput(1000.0),
        ),
        RegisterKind(
            name=SUPPLY,
            words="supply voltage",
            read=lambda table: None,  # not a setting: `nas.voltage` of the frames
            change=RegisterRatio("torque per duty", scale_supply, is_position_servo),
            is_positive=True,
            is_measured=True,
        ),
    )
}
