"""An arm of XL-320 servos: found, checked, set up, read and commanded once a cycle, and left safe."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from types import TracebackType

import numpy as np

from nas_data.errors import ArmError, ServoSilent
from nas_data.hardware.arms.base import Health, Reading
from nas_data.hardware.arms.safety import OPENER, make_safe
from nas_data.hardware.xl320.bus import Answer, Bus
from nas_data.hardware.xl320.configuration import Configuration
from nas_data.hardware.xl320.control_table import FEEDBACK, FEEDBACK_SIZE, HEALTH, HEALTH_SIZE, SETTINGS
from nas_data.hardware.xl320.fitness import refuse_outside, refuse_unfit
from nas_data.hardware.xl320.joints import Joints
from nas_data.hardware.xl320.port import open_port
from nas_data.hardware.xl320.survey import FoundServo, no_answer_error, survey
from nas_data.hardware.xl320.units import HIGHEST, VOLT


class Xl320Arm:
    """An arm on a port; a context that leaves it without torque.

    Attributes:
        joints: Its joints and servos.
        configuration: How its servos are set up before they move.
        bus: Its line.
        sequential: Whether its servos are read one by one, because they do not know sync read.
        retries: Readings that needed more than one attempt.
    """

    def __init__(
        self,
        port: str,
        joints: Joints,
        now: Callable[[], float] = time.monotonic,
        configuration: Configuration | None = None,
    ) -> None:
        """Open the port.

        Args:
            port: Its path.
            joints: What the arm should have.
            now: Clock that stamps the readings [s].
            configuration: How its servos are to be set up; as `Configuration` says where not given.

        Raises:
            ArmError: the port cannot be opened; see `open_port`.
        """
        self.joints, self.port = joints, port
        self.bus = Bus(open_port(port))
        self._now = now
        self.sequential = False
        self.retries = 0
        self.configuration = configuration or Configuration()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the joints."""
        return self.joints.names

    def check(self) -> list[FoundServo]:
        """Look at every servo, and refuse an arm that cannot be used.

        Raises:
            ArmError: nobody answers, a servo is missing, twice there, of another model, shut down; the supply is low;
                a joint stands outside its limits.
        """
        found = survey(self.bus, self.joints.ids)
        for servo in found:
            refuse_unfit(self._name(servo.id), self.health(servo.id))
        self.sequential = self.bus.sync_read(self.joints.ids, FEEDBACK, FEEDBACK_SIZE) is None and (
            self.bus.sync_read(self.joints.ids, FEEDBACK, FEEDBACK_SIZE) is None
        )
        refuse_outside(self.joints, self.read().positions)
        return found

    def configure(self, configuration: Configuration | None = None) -> None:
        """Set every servo up, as another configuration says where one is given; the torque is off afterwards.

        Raises:
            ArmError: a servo does not take it.
        """
        self.configuration = configuration or self.configuration
        low, high = self.joints.raw(np.array(self.joints.low)), self.joints.raw(np.array(self.joints.high))
        ends = np.clip(np.sort([low, high], axis=0), 0, HIGHEST).T.tolist()
        for identity, (first, last) in zip(self.joints.ids, ends, strict=True):
            self.configuration.write(self.bus, identity, (first, last))

    def torque_on(self) -> None:
        """Switch the torque on where the arm stands: the goals of before are forgotten first, and surely.

        Raises:
            ArmError: a servo does not confirm it.
        """
        ticks = self.joints.ticks(self.read().positions).tolist()
        for identity, goal in zip(self.joints.ids, ticks, strict=True):
            self.bus.write(identity, "goal_position", goal)
            self.bus.write(identity, "torque_enable", 1)

    def torque_off(self) -> None:
        """Switch the torque off at once, whatever moves."""
        for _ in range(3):  # nobody confirms it, and it must not get lost
            self.bus.sync_write("torque_enable", dict.fromkeys(self.joints.ids, 0))

    def command(self, positions: np.ndarray) -> np.ndarray:
        """Send goals [rad], shape (n,); return them as they were sent: within the limits, in whole ticks."""
        ticks = self.joints.ticks(positions)
        self.bus.sync_write("goal_position", dict(zip(self.joints.ids, ticks.tolist(), strict=True)))
        return self.joints.positions(ticks)

    def read(self) -> Reading:
        """Read position, speed and load of every servo in one exchange, or one by one where that fails.

        Raises:
            ArmError: nobody answers, or a servo does not, after several attempts.
        """
        began = self._now()
        answers = None if self.sequential else self.bus.sync_read(self.joints.ids, FEEDBACK, FEEDBACK_SIZE)
        if answers is None:
            self.retries += not self.sequential
            began = self._now()
            answers = self._one_by_one()
        return self._reading(answers, (began + self._now()) / 2)

    def health(self, identity: int) -> Health:
        """Read voltage, temperature and hardware error of one servo; raises as `Bus.read` does."""
        answer = self.bus.read(identity, HEALTH, HEALTH_SIZE)
        return Health(
            answer.register("present_voltage", HEALTH) * VOLT,
            answer.register("present_temperature", HEALTH),
            answer.register("hardware_error", HEALTH),
        )

    def refuse_alerts(self, reading: Reading) -> None:
        """Say why a servo has shut down.

        Raises:
            ArmError: one has.
        """
        for identity in reading.alerts:
            refuse_unfit(self._name(identity), self.health(identity))

    def check_servo(self, index: int) -> Health:
        """Read supply and warmth of the servo of one joint, and refuse it where it is unfit; raises as `check` does."""
        identity = self.joints.ids[index]
        health = self.health(identity)
        refuse_unfit(self._name(identity), health)
        return health

    def registers(self) -> dict[str, dict[str, int]]:
        """Read the settings of every servo, by joint and register; raises as `Bus.read` does."""
        answers = [
            self.bus.read(identity, 0, max(r.address + r.size for r in SETTINGS)) for identity in self.joints.ids
        ]
        return {
            joint: {register.name: answer.register(register.name, 0) for register in SETTINGS}
            for joint, answer in zip(self.joints.names, answers, strict=True)
        }

    def read_position(self) -> np.ndarray:
        """Return the positions [rad], shape (n,); raises as `read` does."""
        return self.read().positions

    def hold(self, position: np.ndarray) -> None:
        """Command positions [rad], shape (n,); raises as `command` does."""
        self.command(position)

    def speed(self) -> float:
        """Return the speed of the fastest joint [rad/s]; raises as `read` does."""
        return float(np.abs(self.read().velocities).max())

    def find_unconfirmed(self) -> list[int]:
        """Return the servos that do not confirm that their torque is off."""
        return [identity for identity in self.joints.ids if not self._is_off(identity)]

    def make_safe(self) -> str:
        """Leave the arm without torque; see `nas_data.hardware.arms.safety`."""
        return make_safe(self)

    def close(self) -> None:
        """Give the port back."""
        self.bus.port.closePort()

    def describe(self) -> dict[str, object]:
        """Return what provenance records about the hardware."""
        return {
            "kind": "hardware",
            "servo": "XL-320",
            "ids": list(self.joints.ids),
            "zero_offsets_ticks": list(self.joints.offsets),
            "sequential_reads": self.sequential,
            "configuration": self.configuration.to_json(),
        }

    def _name(self, identity: int) -> str:
        return f"Servo {identity} ({self.joints.names[self.joints.ids.index(identity)]})"

    def _is_off(self, identity: int) -> bool:
        """Whether a servo confirms that its torque is off."""
        try:
            return self.bus.get(identity, "torque_enable") == 0
        except ArmError:
            return False

    def _one_by_one(self) -> list[Answer]:
        """Read every servo by itself.

        Raises:
            NobodyAnswers: none answers.
            ServoSilent, BadReply: one does not.
        """
        try:
            return [self.bus.read(identity, FEEDBACK, FEEDBACK_SIZE) for identity in self.joints.ids]
        except ServoSilent:
            if not any(self.bus.ping(identity) for identity in self.joints.ids):
                raise no_answer_error(self.port) from None
            raise

    def _reading(self, answers: Sequence[Answer], when: float) -> Reading:
        raw = b"".join(answer.data for answer in answers)
        words = np.frombuffer(raw, "<u2").reshape(-1, 3).astype(int)
        alerts = tuple(i for i, answer in zip(self.joints.ids, answers, strict=True) if answer.alert)
        position, speed, load = words.T
        joints = self.joints
        return Reading(when, joints.positions(position), joints.velocities(speed), joints.loads(load), raw, alerts)

    def __enter__(self) -> "Xl320Arm":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.make_safe()
        self.close()


@dataclass(frozen=True, kw_only=True)
class Xl320:
    """The driver of an arm of XL-320 servos.

    Attributes:
        port: Its path.
        joints: What the arm should have.
        configuration: How its servos are set up.
    """

    port: str
    joints: Joints
    configuration: Configuration = field(default_factory=Configuration)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the joints."""
        return self.joints.names

    @property
    def speed(self) -> float:
        """Speed that its servos are limited to [rad/s]; 0 for none."""
        return self.configuration.speed

    def open(self, now: Callable[[], float] = time.monotonic) -> Xl320Arm:
        """Open the port; see `Xl320Arm`."""
        return Xl320Arm(self.port, self.joints, now, self.configuration)

    def guard_options(self) -> dict[str, object]:
        """Return what a guard needs."""
        return {OPENER: f"{__name__}:{open_guarded.__name__}", "port": self.port, "joints": asdict(self.joints)}


def open_guarded(port: str, joints: Mapping[str, Sequence[object]]) -> Xl320Arm:
    """Open an arm in order to stop it; see `Xl320.guard_options`."""
    return Xl320Arm(port, Joints(**{key: tuple(value) for key, value in joints.items()}))  # type: ignore[arg-type]
