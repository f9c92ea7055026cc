"""Faults of virtual arms: a fault changes the arm at a given time, or disturbs the bus from then on."""

from dataclasses import dataclass, fields

import numpy as np

from nas_data.errors import OptionError, UnknownName
from nas_data.hardware.virtual_bus.arm import VirtualArm
from nas_data.hardware.virtual_bus.kinds.base import Reason
from nas_data.hardware.virtual_bus.servo import VirtualServo
from nas_data.registry import to_snake_case

XL330_M077 = 1190  # model number, ROBOTIS e-manual


class LineGone(Exception):
    """The adapter and its port have vanished."""


@dataclass(frozen=True, kw_only=True)
class Fault:
    """Base of the faults; the class `AB`, or `ABFault` where another class is called so, is the fault `a_b`."""

    after: float = 0.0  # time after the start of the bus at which it begins [s]

    def apply(self, arm: VirtualArm) -> None:
        """Apply the fault to the arm, once.

        Raises:
            LineGone: the line is gone.
        """

    def instruction(self, content: bytes, rng: np.random.Generator) -> bytes:
        """Return the instruction bytes as the servos receive them."""
        return content

    def reply(self, content: bytes, rng: np.random.Generator) -> bytes:
        """Return the bytes of a reply as the computer receives them."""
        return content

    def delay(self, rng: np.random.Generator) -> float:
        """Return the extra delay of replies [s]."""
        return 0.0


def find_servo(arm: VirtualArm, identity: int) -> VirtualServo:
    """Return the servo with an ID that a fault names.

    Raises:
        OptionError: the arm has no such servo.
    """
    servos = arm.chain.find_servos(identity)
    if not servos:
        known = ", ".join(str(servo.get("id")) for servo in arm.chain.servos)
        raise OptionError(f"A fault names servo {identity}; the virtual arm has: {known}.")
    return servos[0]


@dataclass(frozen=True, kw_only=True)
class Unplugged(Fault):
    """A servo is unplugged: it neither answers nor moves."""

    servo: int = 3  # its ID

    def apply(self, arm: VirtualArm) -> None:
        """Remove the servo from the line."""
        servo = find_servo(arm, self.servo)
        servo.put("torque_enable", 0)
        arm.chain.servos.remove(servo)


@dataclass(frozen=True, kw_only=True)
class DuplicateIdFault(Fault):
    """Two servos have the same ID and answer at the same time."""

    servo: int = 4  # ID of the servo before
    identity: int = 3  # its new ID
    return_delay: int = 250  # its return delay in units of 2 µs; the default is the factory setting

    def apply(self, arm: VirtualArm) -> None:
        """Change the ID."""
        servo = find_servo(arm, self.servo)
        servo.put("id", self.identity)
        servo.put("return_delay", self.return_delay)


@dataclass(frozen=True, kw_only=True)
class WrongModelFault(Fault):
    """The arm contains a servo of another series."""

    servo: int = 5  # its ID
    model: int = XL330_M077  # its model number

    def apply(self, arm: VirtualArm) -> None:
        """Change the model number."""
        find_servo(arm, self.servo).put("model_number", self.model)


@dataclass(frozen=True, kw_only=True)
class NoSyncRead(Fault):
    """The servos do not support sync read, as with some firmware and adapters."""

    def apply(self, arm: VirtualArm) -> None:
        """Disable sync read."""
        for servo in arm.servos:
            servo.answers_sync = False


@dataclass(frozen=True, kw_only=True)
class LostPacket(Fault):
    """Lost instructions and replies."""

    share: float = 0.01  # share of the packets that are lost

    def instruction(self, content: bytes, rng: np.random.Generator) -> bytes:
        """Drop a random share of the instructions."""
        return self.reply(content, rng)

    def reply(self, content: bytes, rng: np.random.Generator) -> bytes:
        """Drop a random share of the replies."""
        return b"" if rng.random() < self.share else content


@dataclass(frozen=True, kw_only=True)
class CorruptedPacket(Fault):
    """Bit errors on the line, in both directions."""

    share: float = 0.01  # share of the packets with one wrong bit

    def instruction(self, content: bytes, rng: np.random.Generator) -> bytes:
        """Flip a bit in a random share of the instructions."""
        return self.reply(content, rng)

    def reply(self, content: bytes, rng: np.random.Generator) -> bytes:
        """Flip a bit in a random share of the replies."""
        if not content or rng.random() >= self.share:
            return content
        damaged = bytearray(content)
        damaged[int(rng.integers(len(damaged)))] ^= 1 << int(rng.integers(8))
        return bytes(damaged)


@dataclass(frozen=True, kw_only=True)
class Latency(Fault):
    """Some replies are delayed, as by an adapter with a slow latency timer or a busy computer."""

    share: float = 0.01  # share of the instructions with delayed replies
    seconds: float = 0.06  # delay [s]

    def delay(self, rng: np.random.Generator) -> float:
        """Return the delay [s] for a random share of the instructions, else 0."""
        return self.seconds if rng.random() < self.share else 0.0


@dataclass(frozen=True, kw_only=True)
class Stale(Fault):
    """Readings are updated less often than they are read, as if a slower loop read the bus."""

    every: int = 2  # update period of the readings in steps of 10 ms

    def apply(self, arm: VirtualArm) -> None:
        """Set the update period."""
        arm.body.renewal = self.every * 0.01


@dataclass(frozen=True, kw_only=True)
class Undervoltage(Fault):
    """The supply voltage is too low for all servos."""

    volts: float = 5.5  # supply voltage [V]

    def apply(self, arm: VirtualArm) -> None:
        """Lower the supply voltage."""
        electrics = arm.body.electrics
        electrics.supply = electrics.voltage = self.volts
        arm.body.sense()


@dataclass(frozen=True, kw_only=True)
class Overheat(Fault):
    """A servo overheats and shuts down."""

    servo: int = 2  # its ID
    celsius: float = 80.0  # temperature [°C]; the servo shuts down above its limit, 65 °C at the factory

    def apply(self, arm: VirtualArm) -> None:
        """Heat the servo."""
        index = arm.servos.index(find_servo(arm, self.servo))
        arm.body.electrics.temperature[index] = self.celsius
        arm.body.sense()


@dataclass(frozen=True, kw_only=True)
class Overload(Fault):
    """A servo was stalled for too long and shuts down; its torque limit is set to zero."""

    servo: int = 2  # its ID

    def apply(self, arm: VirtualArm) -> None:
        """Shut the servo down."""
        find_servo(arm, self.servo).fail(Reason.OVERLOAD)


@dataclass(frozen=True, kw_only=True)
class AdapterPulled(Fault):
    """The USB adapter is unplugged."""

    def apply(self, arm: VirtualArm) -> None:
        """Close the port."""
        raise LineGone


@dataclass(frozen=True, kw_only=True)
class Bent(Fault):
    """A joint was moved by hand before the recording, possibly beyond its limits."""

    servo: int = 1  # number of its servo in the arm, from 1
    radians: float = 1.9  # new position of the joint [rad]

    def apply(self, arm: VirtualArm) -> None:
        """Move the joint.

        Raises:
            OptionError: the arm has no such servo.
        """
        if not 1 <= self.servo <= len(arm.servos):
            raise OptionError(f"A fault bends servo {self.servo}; the virtual arm has 1 to {len(arm.servos)}.")
        positions = arm.body.positions.copy()
        positions[self.servo - 1] = self.radians
        arm.body.set_state(np.concatenate([positions, np.zeros_like(positions)]))


@dataclass(frozen=True, kw_only=True)
class Zeroed(Fault):
    """The arm is put into its zero pose by hand, as for a calibration."""

    def apply(self, arm: VirtualArm) -> None:
        """Set the pose."""
        arm.body.set_state(np.zeros(2 * len(arm.servos)))


def list_faults() -> dict[str, type[Fault]]:
    """Return every class of faults by its name."""
    return {to_snake_case(kind.__name__.removesuffix("Fault")): kind for kind in Fault.__subclasses__()}


def parse(text: str) -> Fault:
    """Parse a fault such as `unplugged:servo=3,after=20`.

    Raises:
        UnknownName: there is no such fault.
        OptionError: the text is malformed, or a parameter is unknown.
    """
    name, _, rest = text.partition(":")
    kinds = list_faults()
    if name not in kinds:
        raise UnknownName("fault", name, sorted(kinds))
    kind = kinds[name]
    known = {field.name: field.type for field in fields(kind)}
    pairs = [part.partition("=") for part in rest.split(",") if part]
    unknown = [key for key, _, _ in pairs if key.strip() not in known]
    if unknown:
        raise OptionError(f"{name} has no parameter '{unknown[0]}'; it has: {', '.join(sorted(known))}.")
    try:
        values = {key.strip(): int(value) if known[key.strip()] is int else float(value) for key, _, value in pairs}
        return kind(**values)
    except (ValueError, TypeError):
        raise OptionError(f"'{text}' is not a fault; write NAME:PARAMETER=NUMBER,… with: {', '.join(known)}.") from None
