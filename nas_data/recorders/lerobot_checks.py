"""Checks of an arm driven by LeRobot: servos present and healthy, calibration equal to the file, joints in limits."""

from typing import TYPE_CHECKING

import numpy as np

from nas_data.errors import (
    ArmError,
    DuplicateId,
    NobodyAnswers,
    OptionError,
    OutsideLimits,
    ServoHot,
    ServoOverloaded,
    ServoSilent,
    SupplyLow,
    WrongModel,
)
from nas_data.hardware.arms.base import Health
from nas_data.hardware.xl320.survey import MARGIN
from nas_data.joint_units import HINGE, compute_angle_scales, find_joint_unit

if TYPE_CHECKING:
    from nas_data.recorders.lerobot_arm import LeRobotArm

VOLTAGE, OVERHEAT, OVERLOAD = 1, 4, 32  # bits of the hardware error register, the same for both makers
TRIES = 3  # attempts to find a servo, or a second one with the same ID; one reply may come late


def find_servo(arm: "LeRobotArm", identity: int) -> int | None:
    """Return the model number of a servo; None if it does not answer in several attempts."""
    tries = (arm.line.ping(identity) for _ in range(TRIES))
    return next((model for model in tries if model is not None), None)


def refuse_strangers(arm: "LeRobotArm") -> None:
    """Refuse a bus whose servos differ from LeRobot's robot class.

    Raises:
        NobodyAnswers: no servo answers.
        DuplicateId: two servos have one ID.
        ServoSilent: a servo is missing.
        WrongModel: a servo is of another model.
    """
    found = {identity: find_servo(arm, identity) for identity in arm.ids}
    here = [identity for identity, model in found.items() if model is not None]
    if not here:
        raise make_no_answer_error(arm.bus.port)
    for identity in here:
        counts = [arm.line.count_replies(identity, arm.reading.start, arm.reading.size) for _ in range(TRIES)]
        if 2 * sum(sound > 1 for sound, _ in counts) > TRIES or all(damaged and not sound for sound, damaged in counts):
            raise DuplicateId(
                f"Two servos have the ID {identity}; unplug all but one of them and give it its own ID "
                "(lerobot-setup-motors)."
            )
    missing = [str(identity) for identity in arm.ids if identity not in here]
    if missing:
        raise ServoSilent(
            f"Servo {', '.join(missing)} does not answer, {', '.join(map(str, here))} do; check its plug and its ID "
            "(lerobot-setup-motors sets IDs)."
        )
    for motor in arm.bus.motors.values():
        known = arm.bus.model_number_table[motor.model]
        if found[motor.id] != known:
            raise WrongModel(
                f"{arm.label(motor.id)} has model number {found[motor.id]}; a {motor.model} has {known}: exchange "
                "the servo."
            )


def refuse_other_calibration(arm: "LeRobotArm") -> None:
    """Refuse servos whose calibration differs from LeRobot's file.

    Raises:
        OptionError: a register differs; the message says how to calibrate again.
    """
    for name, motor in arm.bus.motors.items():
        known = arm.bus.calibration[name]
        wanted = {"Homing_Offset": known.homing_offset, "Min_Position_Limit": known.range_min}
        wanted["Max_Position_Limit"] = known.range_max
        for register, value in wanted.items():
            held = arm.line.read(motor.id, arm.control[register])
            if held != value:
                raise OptionError(
                    f"{arm.label(motor.id)} holds {held} for {register}, its calibration file says {value}; "
                    f"calibrate it again: lerobot-calibrate --robot.type={arm.kind} "
                    f"--robot.port={arm.bus.port} --robot.id={arm.robot.id}."
                )


def refuse_outside(arm: "LeRobotArm", positions: np.ndarray) -> None:
    """Refuse positions [rad; m], shape (n,), outside the joints' limits.

    Raises:
        OutsideLimits: a joint is outside.
    """
    frame = arm.frame
    margins = MARGIN * compute_angle_scales(arm.names, frame.slides, frame.high - frame.low)
    for index, joint in enumerate(arm.names):
        position, low, high = positions[index], frame.low[index], frame.high[index]
        if not low - margins[index] <= position <= high + margins[index]:
            unit = find_joint_unit(joint, frame.slides)
            digits = 0 if unit is HINGE else 1
            raise OutsideLimits(
                f"{joint} is at {unit.text(position, digits)}, outside {unit.factor * low:.{digits}f} … "
                f"{unit.text(high, digits)}; move it there by hand (the torque is off), or calibrate the arm."
            )


def refuse_unfit(name: str, health: Health, lowest: float) -> None:
    """Refuse a servo that has shut down.

    Args:
        name: Name of the servo for messages.
        health: Its voltage, temperature and errors.
        lowest: Its lowest allowed voltage [V].

    Raises:
        ServoHot, ServoOverloaded, SupplyLow: it has shut down for this reason.
    """
    again = "then switch the supply off and on."
    if health.errors & OVERHEAT:
        raise ServoHot(f"{name} shut down at {health.temperature} °C; let it cool, {again}")
    if health.errors & OVERLOAD:
        raise ServoOverloaded(f"{name} shut down by overload; remove the obstacle, {again}")
    if health.errors & VOLTAGE:
        raise SupplyLow(
            f"{name} gets {health.voltage:.1f} V and needs {lowest:.1f} V or more, within its limit; check the supply."
        )


def make_no_answer_error(port: str) -> ArmError:
    """Return the error for a bus on which no servo answers."""
    return NobodyAnswers(
        f"No servo answers on {port}; switch the supply on, check the plug of the first servo, and that it is the "
        "arm's port (lerobot-find-port)."
    )
