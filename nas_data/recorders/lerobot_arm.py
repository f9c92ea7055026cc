"""An arm that LeRobot drives, as the recorder uses it: LeRobot's robot commands and sets up, its bus is read whole."""

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from lerobot.motors.motors_bus import SerialMotorsBus
from lerobot.robots import Robot as LeRobot
from lerobot.utils.errors import DeviceNotConnectedError

from nas_data.errors import ArmError, BadReply, ServoSilent
from nas_data.hardware.arms.base import Health, Reading
from nas_data.hardware.arms.line import ATTEMPTS, Line, Register, charge, report_lost_port
from nas_data.hardware.arms.port_errors import lost_port_error, refusal
from nas_data.recorders.lerobot_checks import (
    VOLTAGE,
    nobody,
    refuse_other_calibration,
    refuse_outside,
    refuse_strangers,
    refuse_unfit,
)
from nas_data.recorders.lerobot_frame import Frame
from nas_data.recorders.lerobot_servos import control_table, family_of, register_of, table_of, units_of

VOLT = 0.1  # [V] a unit of both makers' voltages
FLEETING = ("Present_", "Goal_", "Moving", "Status", "Hardware_Error", "Realtime", "Registered", "Torque_Enable")


class LeRobotArm:
    """An arm on a port.

    Attributes:
        robot: LeRobot's.
        frame: How its servos and the model's joints go together.
        kind: Its `--robot.type`, which several types share.
        line: Its servos.
        control: Their registers by LeRobot's names.
        start: First byte of what is read of each every time.
        end: What follows its last byte.
        sequential: Whether they are read one by one, because they do not know sync read.
        retries: Readings that needed more than one attempt.
    """

    def __init__(self, robot: LeRobot, kind: str, frame: Frame, now: Callable[[], float]) -> None:
        """Open the port; nothing moves.

        Args:
            robot: LeRobot's.
            kind: Its `--robot.type`, which several types share.
            frame: How its servos and the model's joints go together.
            now: Clock that stamps the readings [s].

        Raises:
            ArmError: the port cannot be opened.
        """
        self.robot, self.frame, self.kind, self._now = robot, frame, kind, now
        self.bus: SerialMotorsBus = robot.bus
        self.sequential, self.retries = False, 0
        self.control = {name: register_of(self.bus, name) for name in control_table(self.bus)}
        self._family = family_of(self.bus)
        try:
            self.bus.connect(handshake=False)
        except ConnectionError as error:
            cause = error.__cause__ if isinstance(error.__cause__, OSError | ValueError) else error
            raise refusal(self.bus.port, cause) from None
        self.line = Line(table_of(self.bus), self.ids, self.bus.port_handler, self.bus.packet_handler)
        self.bus.write = self._patiently(type(self.bus).write)
        self.bus.read = self._patiently(type(self.bus).read)
        self.start, self.end = self._stretch()
        self._last: list[bytes] = []

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the joints."""
        return self.frame.names

    @property
    def ids(self) -> tuple[int, ...]:
        """Identities of the servos."""
        return tuple(motor.id for motor in self.bus.motors.values())

    def check(self) -> None:
        """Look at every servo, and refuse an arm that cannot be used.

        Raises:
            ArmError: nobody answers, a servo is missing, twice there, of another model, shut down; the supply is low;
                a joint stands outside its limits.
            OptionError: the servos hold another calibration than LeRobot's file.
        """
        refuse_strangers(self)
        for place in range(len(self.names)):
            self.look_after(place)
        refuse_other_calibration(self)
        self.sequential = self._sync() is None and self._sync() is None
        refuse_outside(self, self.read().positions)

    def configure(self) -> None:
        """Let LeRobot set the servos up, where they stand: it switches their torque on again itself.

        Raises:
            ArmError: a servo does not take it.
        """
        self.line.torque_off()
        for identity, count in zip(self.ids, self.line.where(), strict=True):
            self.line.write(identity, self.line.table.goal, int(count))
        self._through_lerobot(self.robot.configure)

    def torque_on(self) -> None:
        """Switch the torque on where the arm stands; raises as `configure` does."""
        self.line.stay(self.line.where())
        self._through_lerobot(self.bus.enable_torque)

    def command(self, positions: np.ndarray) -> np.ndarray:
        """Send goals [rad; m], shape (n,), through LeRobot; return them as they were sent: whole counts, within limits.

        Raises:
            AdapterLost: the port is gone.
        """
        wanted = units_of(self.bus, self.frame.counts(positions))
        action = {f"{name}.pos": value for name, value in zip(self.names, wanted, strict=True)}
        sent: dict[str, float] = {}
        self.line.port.is_using = False  # what an exchange that failed may have left
        self._through_lerobot(lambda: sent.update(self.robot.send_action(action)))
        values = {motor.id: sent[f"{name}.pos"] for name, motor in self.bus.motors.items()}
        return self.frame.positions(np.array(list(self.bus._unnormalize(values).values())))

    def read(self) -> Reading:
        """Read goal, position, speed and load of every servo in one exchange, or one by one where that fails.

        Raises:
            ArmError: nobody answers, or a servo does not, after several attempts.
        """
        began = self._now()
        answers = None if self.sequential else self._sync()
        if answers is None:
            self.retries += not self.sequential
            began = self._now()
            answers = self._one_by_one()
        self._last = answers
        table, errors = self.line.table, self.control[self._family.errors]
        heard = answers if self.start <= errors.address < self.end else []
        return Reading(
            time=(began + self._now()) / 2,
            positions=self.frame.positions(self._column(table.position)),
            velocities=self._column(table.speed) * table.speed_unit * self._per_radian(),
            loads=self._column(self.control[self._family.load]) * self._family.load_unit * np.sign(self.frame.ticks),
            raw=b"".join(self._state(answer) for answer in answers),
            alerts=tuple(i for i, data in zip(self.ids, heard, strict=False) if errors.decode(data, self.start)),
            goals=self.frame.positions(self._column(table.goal)),
        )

    def refuse_alerts(self, reading: Reading) -> None:
        """Say why a servo has shut down.

        Raises:
            ArmError: one has.
        """
        for identity in reading.alerts:
            self.look_after(self.ids.index(identity))

    def look_after(self, place: int) -> Health:
        """Read supply and warmth of the servo of one joint, and refuse it where it is unfit; raises as `check` does."""
        identity = self.ids[place]
        errors = self.line.read(identity, self.control[self._family.errors])
        volts = self.line.read(identity, self.control[self._family.voltage]) * VOLT
        warmth = self.line.read(identity, self.control["Present_Temperature"])
        health = Health(volts, warmth, errors)
        lowest = self.line.read(identity, self.control["Min_Voltage_Limit"]) * VOLT if errors & VOLTAGE else 0.0
        refuse_unfit(self.label(identity), health, lowest)
        return health

    def registers(self) -> dict[str, dict[str, int]]:
        """Read the settings of every servo, by joint and LeRobot's names; raises as `read` does."""
        settings = {name: r for name, r in self.control.items() if not name.startswith(FLEETING)}
        length = max(register.address + register.size for register in settings.values())
        found = {}
        for name, identity in zip(self.names, self.ids, strict=True):
            memory = self.line.read_bytes(identity, 0, length)
            found[name] = {key.strip(): register.decode(memory) for key, register in settings.items()}
        return found

    def where(self) -> np.ndarray:
        """Return where the arm stands; see `Line.where`."""
        return self.line.where()

    def stay(self, there: np.ndarray) -> None:
        """Command the arm to stay there; see `Line.stay`."""
        self.line.stay(there)

    def speed(self) -> float:
        """Return the speed of the fastest servo [rad/s]."""
        return self.line.speed()

    def torque_off(self) -> None:
        """Switch the torque off at once; see `Line.torque_off`."""
        self.line.torque_off()

    def unsure(self) -> list[int]:
        """Return the servos that do not confirm that their torque is off."""
        return self.line.unsure()

    def close(self) -> None:
        """Give the port back."""
        self.line.close()

    def describe(self) -> dict[str, object]:
        """Return what provenance records about the hardware."""
        from importlib.metadata import version

        return {
            "kind": "hardware",
            "lerobot": version("lerobot"),
            "robot_class": type(self.robot).__name__,
            "servos": {name: motor.model for name, motor in self.bus.motors.items()},
            "ids": list(self.ids),
            "units": {name: motor.norm_mode.value for name, motor in self.bus.motors.items()},
            "calibration": {name: asdict(known) for name, known in self.bus.calibration.items()},
            "zeros_counts": self.frame.zeros.tolist(),
            "per_count": self.frame.ticks.tolist(),
            "sequential_reads": self.sequential,
        }

    def label(self, identity: int) -> str:
        """Return what to call a servo."""
        return f"Servo {identity} ({self.names[self.ids.index(identity)]})"

    def _stretch(self) -> tuple[int, int]:
        """Return begin and end of what is read every time."""
        table = self.line.table
        wanted = [table.goal, table.position, table.speed, self.control[self._family.load]]
        errors = self.control[self._family.errors]
        wanted += [errors] if errors.address > table.position.address else []
        return min(one.address for one in wanted), max(one.address + one.size for one in wanted)

    def _sync(self) -> list[bytes] | None:
        return self.line.read_all(self.start, self.end - self.start)

    def _one_by_one(self) -> list[bytes]:
        try:
            return [self.line.read_bytes(identity, self.start, self.end - self.start) for identity in self.ids]
        except ServoSilent:
            if all(self.line.ping(identity) is None for identity in self.ids):
                raise nobody(self.bus.port) from None
            raise

    def _column(self, register: Register) -> np.ndarray:
        return np.array([register.decode(answer, self.start) for answer in self._last], float)

    def _state(self, answer: bytes) -> bytes:
        """Return what an answer says of the servo's motion, without the goal."""
        return answer[self.line.table.position.address - self.start :]

    def _per_radian(self) -> np.ndarray:
        """Return what the joints turn or slide with a radian of their servos, shape (n,)."""
        turns = [self.bus.model_resolution_table[motor.model] for motor in self.bus.motors.values()]
        return np.asarray(self.frame.ticks * np.array(turns) / (2 * np.pi))

    def _patiently(self, exchange: Callable[..., object]) -> Callable[..., object]:
        """Let LeRobot's line ask again where a servo is not heard: its classes ask once, sixty times in a row."""

        def ask(*arguments: object, **options: object) -> object:
            for _ in range(ATTEMPTS - 1):
                try:
                    return exchange(self.bus, *arguments, **options)
                except ConnectionError:
                    self.line.calm()
                    self.line.port.is_using = False
            return exchange(self.bus, *arguments, **options)

        return ask

    def _through_lerobot(self, do: Callable[[], object]) -> None:
        """Do something that only LeRobot does, and say in our words what may go wrong.

        Raises:
            BadReply: a servo did not answer it, or with an error.
            AdapterLost: the port is gone.
        """
        with report_lost_port(self.bus.port):
            self.line.port.ser.reset_input_buffer()
            try:
                do()
            except DeviceNotConnectedError:
                raise lost_port_error(self.bus.port) from None
            except (ConnectionError, RuntimeError) as error:
                if isinstance(error, ArmError):
                    raise
                for place in range(len(self.names)):  # a servo that shut down answers with an error
                    self.look_after(place)
                said = " ".join(str(error).split()).rstrip(".")
                raise BadReply(f"LeRobot could not set a servo up or command it: {said}.") from None


@dataclass(frozen=True, kw_only=True)
class LeRobotDriver:
    """The driver of an arm that LeRobot drives.

    Attributes:
        robot: LeRobot's.
        kind: Its `--robot.type`.
        frame: How its servos and the model's joints go together.
        speed: Speed that commands are limited to [rad/s]; 0 for none.
    """

    robot: LeRobot
    kind: str
    frame: Frame
    speed: float = 0.0

    @property
    def bus(self) -> Any:
        """LeRobot's line to the servos."""
        return self.robot.bus

    @property
    def port(self) -> str:
        """Where it is."""
        return str(self.bus.port)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its joints."""
        return self.frame.names

    def open(self, now: Callable[[], float] = time.monotonic) -> LeRobotArm:
        """Open the port; see `LeRobotArm`."""
        return LeRobotArm(self.robot, self.kind, self.frame, now)

    def charge(self) -> dict[str, object]:
        """Return what a guard needs."""
        return charge(table_of(self.bus), [motor.id for motor in self.bus.motors.values()], self.port)
