"""Report of all servos that answer on a bus and of all problems with them."""

from collections.abc import Iterator
from dataclasses import dataclass

from nas_data.errors import ArmError
from nas_data.hardware.xl320.arm import Xl320Arm
from nas_data.hardware.xl320.control_table import MODEL_NUMBER
from nas_data.hardware.xl320.joints import Joints
from nas_data.hardware.xl320.survey import (
    FoundServo,
    find_answering,
    make_no_answer_error,
    read_servo,
    refuse_duplicates,
    refuse_outside,
    refuse_unfit,
)


@dataclass(frozen=True)
class Inventory:
    """Servos and problems of an arm."""

    servos: tuple[FoundServo, ...]  # servos that could be read, in order of their IDs
    problems: tuple[str, ...]  # problems that prevent use of the arm, one sentence each


def take_inventory(arm: Xl320Arm) -> Inventory:
    """Examine all servos on an arm's bus.

    Raises:
        NobodyAnswers: no servo answers.
        AdapterLost: the port is gone.
    """
    answering = set(arm.bus.broadcast_ping()) | set(find_answering(arm.bus, arm.joints.ids))
    if not answering:
        raise make_no_answer_error(arm.port)
    problems, servos = [], []
    for identity in sorted(answering):
        try:
            refuse_duplicates(arm.bus, [identity])
            servos.append(read_servo(arm.bus, identity))
        except ArmError as error:
            problems.append(str(error))
    return Inventory(tuple(servos), (*problems, *_find_unexpected(arm.joints, answering), *_find_unfit(arm, servos)))


def _find_unexpected(joints: Joints, answering: set[int]) -> Iterator[str]:
    """Yield sentences on missing and on additional servos."""
    for name, identity in zip(joints.names, joints.ids, strict=True):
        if identity not in answering:
            yield f"Servo {identity} ({name}) does not answer; check its plug and its ID."
    for identity in sorted(answering - set(joints.ids)):
        yield f"Servo {identity} is not a servo of this arm; rename it (--rename {identity}:NEW) or unplug it."


def _find_unfit(arm: Xl320Arm, servos: list[FoundServo]) -> Iterator[str]:
    """Yield sentences on servos that must not be used, and on joints outside their limits."""
    names = dict(zip(arm.joints.ids, arm.joints.names, strict=True))
    ours = [servo for servo in servos if servo.id in names]
    for servo in ours:
        name = f"Servo {servo.id} ({names[servo.id]})"
        if servo.model != MODEL_NUMBER:
            yield f"{name} has model number {servo.model}; an XL-320 has {MODEL_NUMBER}: exchange the servo."
            continue
        try:
            refuse_unfit(name, arm.health(servo.id))
        except ArmError as error:
            yield str(error)
    if len(ours) == len(names) and all(servo.model == MODEL_NUMBER for servo in ours):
        try:
            refuse_outside(arm.joints, arm.read().positions)
        except ArmError as error:
            yield str(error)
