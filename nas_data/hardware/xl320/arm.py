"""An arm of XL-320 servos: settings, checks, control and safe stop."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from types import TracebackType

import numpy as np

from nas_data.errors import ArmError, OptionError, ServoSilent
from nas_data.hardware.arms.base import ArmOpener, Health, Reading, make_safe
from nas_data.hardware.xl320.bus import Answer, Bus, open_port
from nas_data.hardware.xl320.control_table import (
    FEEDBACK,
    FEEDBACK_SIZE,
    HEALTH,
    HEALTH_SIZE,
    HIGHEST,
    SETTINGS,
    VOLT,
    encode_speed_limit,
)
from nas_data.hardware.xl320.joints import Joints
from nas_data.hardware.xl320.survey import FoundServo, make_no_answer_error, refuse_outside, refuse_unfit, survey

FULL = 1023


@dataclass(frozen=True, kw_only=True)
class Configuration:
    """Settings that are written to every servo."""

    p_gain: int = 32  # proportional gain in the register's units; 32 at the factory
    i_gain: int = 0  # integral gain
    d_gain: int = 0  # derivative gain
    speed: float = 1.745  # speed limit [rad/s]; 0 for none. The paper's recordings had 100°/s.
    torque: float = 1.0  # torque limit as a share of the largest torque; Poppy's software uses 0.7

    def __post_init__(self) -> None:
        for name in ("p_gain", "i_gain", "d_gain"):
            if not 0 <= getattr(self, name) <= 254:
                raise OptionError(f"{name} is {getattr(self, name)}; it must lie in 0 … 254.")
        if not 0 <= self.speed < 12:
            raise OptionError(f"The speed limit is {self.speed} rad/s; it must lie in 0 (none) … 11.9.")
        if not 0 < self.torque <= 1:
            raise OptionError(f"The torque limit is {self.torque}; it must be a share above 0 and up to 1.")

    def write(self, bus: Bus, identity: int, limits: tuple[int, int]) -> None:
        """Write the settings and limits (lowest and highest goal [ticks]) of one servo; its torque is off afterwards.

        Raises:
            ArmError: the servo refuses a setting.
        """
        bus.write(identity, "torque_enable", 0)  # first: persistent registers are locked while the torque is on
        persistent = {"return_delay": 0, "status_level": 2, "control_mode": 2}
        for name, value in (persistent | {"cw_limit": limits[0], "ccw_limit": limits[1]}).items():
            if bus.get(identity, name) != value:  # the persistent memory wears out with every write
                bus.write(identity, name, value)
        for name, value in self.registers().items():
            bus.write(identity, name, value)

    def registers(self) -> dict[str, int]:
        """Return the values of the volatile registers."""
        return {
            "p_gain": self.p_gain,
            "i_gain": self.i_gain,
            "d_gain": self.d_gain,
            "moving_speed": encode_speed_limit(self.speed) if self.speed else 0,
            "torque_limit": round(self.torque * FULL),
        }

    def to_json(self) -> dict[str, object]:
        """Return the settings for provenance."""
        return {**asdict(self), "registers": self.registers(), "return_delay": 0}


class Xl320Arm:
    """An arm on a port; a context manager that switches its torque off at the end."""

    def __init__(
        self,
        port: str,
        joints: Joints,
        now: Callable[[], float] = time.monotonic,
        configuration: Configuration | None = None,
    ) -> None:
        """Open the port.

        Args:
            port: Path of the port.
            joints: Expected joints and servos.
            now: Clock for the time of readings [s].
            configuration: Settings of the servos; the defaults of `Configuration` if None.

        Raises:
            ArmError: the port cannot be opened; see `open_port`.
        """
        self.joints, self.port = joints, port
        self.bus = Bus(open_port(port))
        self._now = now
        self.sequential = False  # whether servos are read one by one, because they do not support sync read
        self.retries = 0  # readings that needed more than one attempt
        self.configuration = configuration or Configuration()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the joints."""
        return self.joints.names

    def check(self) -> list[FoundServo]:
        """Check every servo, and refuse an arm that cannot be used.

        Raises:
            ArmError: no servo answers; a servo is missing, duplicate, of another model, or has shut down; the supply
                voltage is low; or a joint is outside its limits.
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
        """Write the settings of every servo, of another configuration if given; the torque is off afterwards.

        Raises:
            ArmError: a servo refuses a setting.
        """
        self.configuration = configuration or self.configuration
        low, high = self.joints.raw(np.array(self.joints.low)), self.joints.raw(np.array(self.joints.high))
        ends = np.clip(np.sort([low, high], axis=0), 0, HIGHEST).T.tolist()
        for identity, (first, last) in zip(self.joints.ids, ends, strict=True):
            self.configuration.write(self.bus, identity, (first, last))

    def torque_on(self) -> None:
        """Switch the torque on with the present positions as goals, which replace older goals first.

        Raises:
            ArmError: a servo does not confirm the goal or the torque.
        """
        ticks = self.joints.ticks(self.read().positions).tolist()
        for identity, goal in zip(self.joints.ids, ticks, strict=True):
            self.bus.write(identity, "goal_position", goal)
            self.bus.write(identity, "torque_enable", 1)

    def torque_off(self) -> None:
        """Switch the torque off at once, even in motion."""
        for _ in range(3):  # the packet is not confirmed, and must not get lost
            self.bus.sync_write("torque_enable", dict.fromkeys(self.joints.ids, 0))

    def command(self, positions: np.ndarray) -> np.ndarray:
        """Send goals [rad], shape (n,); return them as sent: within the limits and rounded to ticks."""
        ticks = self.joints.ticks(positions)
        self.bus.sync_write("goal_position", dict(zip(self.joints.ids, ticks.tolist(), strict=True)))
        return self.joints.positions(ticks)

    def read(self) -> Reading:
        """Read position, speed and load of every servo by one sync read, or one by one if that fails.

        Raises:
            ArmError: no servo answers, or one does not after several attempts.
        """
        start = self._now()
        answers = None if self.sequential else self.bus.sync_read(self.joints.ids, FEEDBACK, FEEDBACK_SIZE)
        if answers is None:
            self.retries += not self.sequential
            start = self._now()
            answers = self._read_one_by_one()
        return self._decode_reading(answers, (start + self._now()) / 2)

    def health(self, identity: int) -> Health:
        """Read voltage, temperature and hardware error of one servo; raises like `Bus.read`."""
        answer = self.bus.read(identity, HEALTH, HEALTH_SIZE)
        return Health(
            answer.register("present_voltage", HEALTH) * VOLT,
            answer.register("present_temperature", HEALTH),
            answer.register("hardware_error", HEALTH),
        )

    def refuse_alerts(self, reading: Reading) -> None:
        """Check that no servo has shut down.

        Raises:
            ArmError: a servo has shut down; the message gives the reason.
        """
        for identity in reading.alerts:
            refuse_unfit(self._name(identity), self.health(identity))

    def check_servo(self, index: int) -> Health:
        """Read and check the health of the servo of joint `index`; raises like `check`."""
        identity = self.joints.ids[index]
        health = self.health(identity)
        refuse_unfit(self._name(identity), health)
        return health

    def registers(self) -> dict[str, dict[str, int]]:
        """Read the settings of every servo, by joint and register; raises like `Bus.read`."""
        answers = [
            self.bus.read(identity, 0, max(r.address + r.size for r in SETTINGS)) for identity in self.joints.ids
        ]
        return {
            joint: {register.name: answer.register(register.name, 0) for register in SETTINGS}
            for joint, answer in zip(self.joints.names, answers, strict=True)
        }

    def read_position(self) -> np.ndarray:
        """Return the positions [rad], shape (n,); raises like `read`."""
        return self.read().positions

    def hold(self, position: np.ndarray) -> None:
        """Command positions [rad], shape (n,); raises like `command`."""
        self.command(position)

    def speed(self) -> float:
        """Return the speed of the fastest joint [rad/s]; raises like `read`."""
        return float(np.abs(self.read().velocities).max())

    def find_unconfirmed(self) -> list[int]:
        """Return the IDs of servos that do not confirm that their torque is off."""
        return [identity for identity in self.joints.ids if not self._is_off(identity)]

    def make_safe(self) -> str:
        """Stop the arm and switch its torque off; see `nas_data.hardware.arms.base`."""
        return make_safe(self)

    def close(self) -> None:
        """Close the port."""
        self.bus.port.closePort()

    def describe(self) -> dict[str, object]:
        """Return the description of the hardware for provenance."""
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

    def _read_one_by_one(self) -> list[Answer]:
        """Read the servos one by one; raise NobodyAnswers, ServoSilent or BadReply."""
        try:
            return [self.bus.read(identity, FEEDBACK, FEEDBACK_SIZE) for identity in self.joints.ids]
        except ServoSilent:
            if not any(self.bus.ping(identity) for identity in self.joints.ids):
                raise make_no_answer_error(self.port) from None
            raise

    def _decode_reading(self, answers: Sequence[Answer], when: float) -> Reading:
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
    """The driver of an arm of XL-320 servos."""

    port: str  # path of the port
    joints: Joints  # expected joints and servos
    configuration: Configuration = field(default_factory=Configuration)  # settings of the servos

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the joints."""
        return self.joints.names

    @property
    def speed(self) -> float:
        """Speed limit of the servos [rad/s]; 0 for none."""
        return self.configuration.speed

    def open(self, now: Callable[[], float] = time.monotonic) -> Xl320Arm:
        """Open the port; see `Xl320Arm`."""
        return Xl320Arm(self.port, self.joints, now, self.configuration)

    def opener(self) -> ArmOpener:
        """Return how the watchdog opens the arm."""
        return ArmOpener(f"{__name__}:{open_guarded.__name__}", {"port": self.port, "joints": asdict(self.joints)})


def open_guarded(port: str, joints: Mapping[str, Sequence[object]]) -> Xl320Arm:
    """Open an arm in order to stop it; see `Xl320.opener`."""
    return Xl320Arm(port, Joints(**{key: tuple(value) for key, value in joints.items()}))  # type: ignore[arg-type]
