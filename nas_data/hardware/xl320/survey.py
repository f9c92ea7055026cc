"""What is found on a line: each servo with its model, state and place, or why it is not usable."""

from collections.abc import Sequence
from dataclasses import dataclass

from nas_data.errors import ArmError, DuplicateId, NobodyAnswers, ServoSilent, WrongModel
from nas_data.hardware.xl320.bus import Bus
from nas_data.hardware.xl320.control_table import FEEDBACK, MODEL_NUMBER, OVERHEAT, OVERLOAD, VOLTAGE
from nas_data.hardware.xl320.units import VOLT

TRIES = 3
MOVING_PART = 10  # bytes from the position to the temperature: what differs between two servos of one identity
FAULTS = {OVERLOAD: "overload", OVERHEAT: "overheating", VOLTAGE: "voltage"}


@dataclass(frozen=True)
class FoundServo:
    """One servo.

    Attributes:
        id: Its identity.
        model: Its model number; 350 is an XL-320.
        firmware: Its firmware's version.
        voltage: At its supply [V].
        temperature: Inside [°C].
        ticks: Where it stands, as it counts itself.
        torque: Whether its torque is on.
        errors: Why it shut down, in words; empty where it did not.
    """

    id: int
    model: int
    firmware: int
    voltage: float
    temperature: int
    ticks: int
    torque: bool
    errors: tuple[str, ...]


def read_servo(bus: Bus, identity: int) -> FoundServo:
    """Read everything about one servo; raises as `Bus.read` does."""
    head = bus.read(identity, 0, 3)
    model = head.register("model_number", 0)
    if model != MODEL_NUMBER:  # another control table: nothing else can be read
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
    """Look at the servos of an arm.

    Raises:
        NobodyAnswers, ServoSilent: none or not all of them answer.
        DuplicateId: two have one identity.
        WrongModel: one is no XL-320.
    """
    here = find_answering(bus, identities)
    if not here:
        raise no_answer_error(bus.port.port_name)
    refuse_duplicates(bus, here)
    missing = [str(identity) for identity in identities if identity not in here]
    if missing:
        raise ServoSilent(
            f"Servo {', '.join(missing)} does not answer, {', '.join(map(str, here))} do; check its plug and its "
            "identity (a new servo has 1, and two with one identity cannot be told apart)."
        )
    found = [read_servo(bus, identity) for identity in identities]
    for servo in found:
        if servo.model != MODEL_NUMBER:
            raise WrongModel(
                f"Servo {servo.id} has model number {servo.model}; an XL-320 has {MODEL_NUMBER}: exchange the servo."
            )
    return found


def find_answering(bus: Bus, identities: Sequence[int]) -> list[int]:
    """Return which servos answer, in any of several tries."""
    return [identity for identity in identities if any(bus.ping(identity) for _ in range(TRIES))]


def refuse_duplicates(bus: Bus, identities: Sequence[int]) -> None:
    """Find identities to which two servos answer: one after the other, or over each other.

    Raises:
        DuplicateId: there is one.
    """
    for identity in identities:
        heard = [bus.count_replies(identity, FEEDBACK, MOVING_PART) for _ in range(TRIES)]
        if 2 * sum(sound > 1 for sound, _ in heard) > TRIES or all(damaged and not sound for sound, damaged in heard):
            raise DuplicateId(
                f"Two servos answer as {identity}; unplug all but one of them and give it its own identity "
                f"(nas robot ergojr --port PORT --rename {identity}:NEW)."
            )


def no_answer_error(port: str) -> ArmError:
    """Return what to raise where no servo answers."""
    return NobodyAnswers(
        f"No servo answers on {port}; switch the supply on (7.4 V), check the plug of the first servo, and that it is "
        "the arm's port."
    )
