"""An arm of XL-320 servos: found, checked, set up, read and commanded once a cycle, and left safe."""

import contextlib
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import TracebackType

import numpy as np

from nas_data.errors import ArmError, ServoSilent
from nas_data.xl320.bus import Answer, Bus
from nas_data.xl320.configuration import Configuration
from nas_data.xl320.control_table import FEEDBACK, FEEDBACK_SIZE, HEALTH, HEALTH_SIZE
from nas_data.xl320.fitness import Health, refuse_outside, refuse_unfit
from nas_data.xl320.joints import Joints
from nas_data.xl320.port import open_port
from nas_data.xl320.survey import Found, nobody, survey
from nas_data.xl320.units import HIGHEST, VOLT

SLOW = 0.15  # [rad/s] below which the torque may go without a jerk
PATIENCE = 1.0  # [s] to wait for that


@dataclass(frozen=True)
class Reading:
    """The state of the arm at one moment.

    Attributes:
        time: Monotonic clock, the middle between question and last answer [s].
        positions: [rad], shape (n,).
        velocities: [rad/s], shape (n,).
        loads: Shares of the largest torque, shape (n,).
        raw: What the servos said, byte for byte.
        alerts: Identities of servos with a hardware error.
    """

    time: float
    positions: np.ndarray
    velocities: np.ndarray
    loads: np.ndarray
    raw: bytes
    alerts: tuple[int, ...]


class Arm:
    """An arm on a port; a context that leaves it without torque.

    Attributes:
        joints: Its joints and servos.
        bus: Its line.
        sequential: Whether its servos are read one by one, because they do not know sync read.
        retries: Readings that needed more than one attempt.
    """

    def __init__(self, port: str, joints: Joints, now: Callable[[], float] = time.monotonic) -> None:
        """Open the port.

        Args:
            port: Its path.
            joints: What the arm should have.
            now: Clock that stamps the readings [s].

        Raises:
            ArmError: the port cannot be opened; see `open_port`.
        """
        self.joints, self.port = joints, port
        self.bus = Bus(open_port(port))
        self._now = now
        self.sequential = False
        self.retries = 0
        self.configuration: Configuration | None = None

    def check(self) -> list[Found]:
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

    def configure(self, configuration: Configuration) -> None:
        """Set every servo up; the torque is off afterwards.

        Raises:
            ArmError: a servo does not take it.
        """
        low, high = self.joints.raw(np.array(self.joints.low)), self.joints.raw(np.array(self.joints.high))
        ends = np.clip(np.sort([low, high], axis=0), 0, HIGHEST).T.tolist()
        for identity, (first, last) in zip(self.joints.ids, ends, strict=True):
            configuration.write(self.bus, identity, (first, last))
        self.configuration = configuration

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

    def make_safe(self) -> str:
        """Hold the arm where it is, wait until it is slow, switch the torque off; return what could not be done."""
        with contextlib.suppress(ArmError):  # what keeps the arm from being read has been said, or is said below
            self._hold()
        try:
            self.torque_off()
        except ArmError as error:
            return f"The torque could not be switched off; switch the supply off. {error}"
        unsure = [str(identity) for identity in self.joints.ids if not self._is_off(identity)]
        if unsure:
            return f"Servo {', '.join(unsure)} did not confirm that its torque is off; switch the supply off."
        return ""

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
            "configuration": self.configuration.to_json() if self.configuration else None,
        }

    def _name(self, identity: int) -> str:
        return f"Servo {identity} ({self.joints.names[self.joints.ids.index(identity)]})"

    def _hold(self) -> None:
        until = time.monotonic() + PATIENCE
        here = self.read().positions
        self.command(here)
        while time.monotonic() < until and np.abs(self.read().velocities).max() > SLOW:
            self.command(here)
            time.sleep(0.01)

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
                raise nobody(self.port) from None
            raise

    def _reading(self, answers: Sequence[Answer], when: float) -> Reading:
        raw = b"".join(answer.data for answer in answers)
        words = np.frombuffer(raw, "<u2").reshape(-1, 3).astype(int)
        alerts = tuple(i for i, answer in zip(self.joints.ids, answers, strict=True) if answer.alert)
        position, speed, load = words.T
        joints = self.joints
        return Reading(when, joints.positions(position), joints.velocities(speed), joints.loads(load), raw, alerts)

    def __enter__(self) -> "Arm":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.make_safe()
        self.close()
