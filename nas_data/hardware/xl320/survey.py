"""Search for the servos on a bus, the state of each, and whether an arm of them may move."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nas_data.errors import (
    ArmError,
    DuplicateId,
    NobodyAnswers,
    OutsideLimits,
    ServoHot,
    ServoOverloaded,
    ServoSilent,
    SupplyLow,
    WrongModel,
)
from nas_data.hardware.arms.base import Health
from nas_data.hardware.xl320.bus import Bus
from nas_data.hardware.xl320.control_table import FEEDBACK, MODEL_NUMBER, OVERHEAT, OVERLOAD, VOLT, VOLTAGE
from nas_data.hardware.xl320.joints import Joints

TRIES = 3
MOVING_PART = 10  # bytes from position to temperature, which differ between two servos with one ID
FAULTS = {OVERLOAD: "overload", OVERHEAT: "overheating", VOLTAGE: "voltage"}


@dataclass(frozen=True)
class FoundServo:
    """One servo."""

    id: int
    model: int  # its model number; 350 is an XL-320
    firmware: int  # version of its firmware
    voltage: float  # supply voltage [V]
    temperature: int  # internal temperature [°C]
    ticks: int  # position [ticks]
    torque: bool  # whether its torque is on
    errors: tuple[str, ...]  # reasons of a shutdown in words; empty without one


def read_servo(bus: Bus, identity: int) -> FoundServo:
    """Read model and state of one servo; raises like `Bus.read`."""
    head = bus.read(identity, 0, 3)
    model = head.register("model_number", 0)
    if model != MODEL_NUMBER:  # other models have another control table
        return FoundServo(identity, model, head.register("firmware", 0), 0.0, 0, 0, False, ())
    live = bus.read(identity, FEEDBACK, MOVING_PART)
    error = bus.get(identity, "hardware_error")
    return FoundServo(
        id=identity,
        model=model,
        firmware=head.register("firmware", 0),
        voltage=live.register("present_voltage", FEEDBACK) * VOLT,
        temperature=live.register("present_temperature", FEEDBACK),
        ticks=live.register("present_position", FEEDBACK),
        torque=bool(bus.get(identity, "torque_enable")),
        errors=tuple(word for bit, word in FAULTS.items() if error & bit),
    )


def survey(bus: Bus, identities: Sequence[int]) -> list[FoundServo]:
    """Find and read the servos of an arm.

    Raises:
        NobodyAnswers, ServoSilent: no servo, or not every servo, answers.
        DuplicateId: two servos have the same ID.
        WrongModel: a servo is no XL-320.
    """
    answering = find_answering(bus, identities)
    if not answering:
        raise make_no_answer_error(bus.port.port_name)
    refuse_duplicates(bus, answering)
    missing = [str(identity) for identity in identities if identity not in answering]
    if missing:
        raise ServoSilent(
            f"Servo {', '.join(missing)} does not answer, {', '.join(map(str, answering))} do; check its plug and its "
            "ID (a new servo has ID 1, and two servos with one ID cannot be distinguished)."
        )
    found = [read_servo(bus, identity) for identity in identities]
    for servo in found:
        if servo.model != MODEL_NUMBER:
            raise WrongModel(
                f"Servo {servo.id} has model number {servo.model}; an XL-320 has {MODEL_NUMBER}: exchange the servo."
            )
    return found


def find_answering(bus: Bus, identities: Sequence[int]) -> list[int]:
    """Return the IDs that answer a ping in any of several tries."""
    return [identity for identity in identities if any(bus.ping(identity) for _ in range(TRIES))]


def refuse_duplicates(bus: Bus, identities: Sequence[int]) -> None:
    """Refuse IDs to which two servos answer, in succession or at the same time.

    Raises:
        DuplicateId: there is such an ID.
    """
    for identity in identities:
        counts = [bus.count_replies(identity, FEEDBACK, MOVING_PART) for _ in range(TRIES)]
        if 2 * sum(sound > 1 for sound, _ in counts) > TRIES or all(damaged and not sound for sound, damaged in counts):
            raise DuplicateId(
                f"Two servos have the ID {identity}; unplug all but one of them and give it its own ID (nas robot "
                f"ergojr --port PORT --rename {identity}:NEW)."
            )


def make_no_answer_error(port: str) -> ArmError:
    """Return the error if no servo answers."""
    return NobodyAnswers(
        f"No servo answers on {port}; switch the supply on (7.4 V), check the plug of the first servo, and that it is "
        "the arm's port."
    )


LOWEST_VOLTAGE = 6.0  # [V] lowest specified voltage of an XL-320; e-manual
MARGIN = 0.05  # [rad] tolerated initial position beyond a limit: ten ticks of play and sag
COOL = 50  # [°C] to which an overheated servo must cool down


def refuse_unfit(name: str, health: Health) -> None:
    """Refuse a servo that has shut down or has a low supply voltage.

    Raises:
        SupplyLow: the voltage is below 6 V, or the servo reported a voltage error.
        ServoHot, ServoOverloaded: it shut down for that reason.
    """
    again = "then clear it (nas robot ergojr --port PORT --reboot)."
    if health.errors & OVERHEAT:
        raise ServoHot(f"{name} shut down at {health.temperature} °C; let it cool below {COOL} °C, {again}")
    if health.errors & OVERLOAD:
        raise ServoOverloaded(f"{name} shut down by overload; remove the obstacle, {again}")
    if health.voltage < LOWEST_VOLTAGE:
        raise SupplyLow(
            f"{name} gets {health.voltage:.1f} V; an XL-320 needs 6 V: charge or exchange the supply (7.4 V)."
        )
    if health.errors & VOLTAGE:
        raise SupplyLow(f"{name} had a voltage out of its range; check the supply (7.4 V), {again}")


def refuse_outside(joints: Joints, positions: np.ndarray) -> None:
    """Refuse positions [rad], shape (n,), outside the limits: a first command could cause a collision.

    Raises:
        OutsideLimits: a joint is outside its limits.
    """
    for joint, position, low, high in zip(joints.names, positions, joints.low, joints.high, strict=True):
        if not low - MARGIN <= position <= high + MARGIN:
            raise OutsideLimits(
                f"{joint} is at {np.degrees(position):.0f}°, outside {np.degrees(low):.0f} … "
                f"{np.degrees(high):.0f}°; move it there by hand (the torque is off), or calibrate the arm."
            )
