"""An arm driven by LeRobot: LeRobot configures and commands it, and all its servos are read in one transaction."""

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from lerobot.motors.motors_bus import SerialMotorsBus
from lerobot.robots import Robot as LeRobot
from lerobot.utils.errors import DeviceNotConnectedError

from nas_data.errors import ArmError, BadReply, ServoSilent
from nas_data.hardware.arms.base import ArmOpener, Health, Reading
from nas_data.hardware.arms.line import ATTEMPTS, Line, make_line_opener, report_lost_port
from nas_data.hardware.arms.port_errors import make_lost_port_error, make_port_error
from nas_data.recorders.lerobot_checks import (
    VOLTAGE,
    make_no_answer_error,
    refuse_other_calibration,
    refuse_outside,
    refuse_strangers,
    refuse_unfit,
)
from nas_data.recorders.lerobot_frame import Frame
from nas_data.recorders.lerobot_reading import ReadingFormat
from nas_data.recorders.lerobot_servos import (
    convert_to_units,
    find_family,
    find_register,
    find_stop_registers,
    list_shared_registers,
)

VOLT = 0.1  # [V] voltage unit of both makers
TRANSIENT_REGISTERS = (  # the speed of the goal, Goal_Velocity, is a setting
    "Present_",
    "Goal_Position",
    "Goal_Time",
    "Goal_PWM",
    "Goal_Current",
    "Moving",
    "Status",
    "Hardware_Error",
    "Realtime",
    "Registered",
    "Torque_Enable",
)


class LeRobotArm:
    """An arm on a port.

    Attributes:
        robot: LeRobot's robot object.
        frame: Conversion between servo counts and joint positions.
        kind: LeRobot's `--robot.type`.
        line: The bus with its servos.
        control: Registers by LeRobot's names.
        reading: Contents of a regular reading.
        sequential: Whether servos are read one by one, because they lack sync read.
        retries: Readings that needed more than one attempt.
    """

    def __init__(self, robot: LeRobot, kind: str, frame: Frame, now: Callable[[], float]) -> None:
        """Open the port; nothing moves.

        Args:
            robot: LeRobot's robot object.
            kind: LeRobot's `--robot.type`.
            frame: Conversion between servo counts and joint positions.
            now: Clock that stamps the readings [s].

        Raises:
            ArmError: the port cannot be opened.
        """
        self.robot, self.frame, self.kind, self._now = robot, frame, kind, now
        self.bus: SerialMotorsBus = robot.bus
        self.sequential, self.retries = False, 0
        self.control = {name: find_register(self.bus, name) for name in list_shared_registers(self.bus)}
        self._family = find_family(self.bus)
        try:
            self.bus.connect(handshake=False)
        except ConnectionError as error:
            cause = error.__cause__ if isinstance(error.__cause__, OSError | ValueError) else error
            raise make_port_error(self.bus.port, cause) from None
        self.line = Line(find_stop_registers(self.bus), self.ids, self.bus.port_handler, self.bus.packet_handler)
        self.bus.write = self._wrap_with_retries(type(self.bus).write)
        self.bus.read = self._wrap_with_retries(type(self.bus).read)
        self.reading = ReadingFormat(self.bus, frame)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the joints."""
        return self.frame.names

    @property
    def ids(self) -> tuple[int, ...]:
        """IDs of the servos."""
        return tuple(motor.id for motor in self.bus.motors.values())

    def check(self) -> None:
        """Check every servo; refuse an arm that cannot be used.

        Raises:
            ArmError: no servo answers; one is missing, has a duplicate ID, is of another model or has shut down; the
                supply voltage is low; a joint is outside its limits.
            OptionError: the servos' calibration differs from LeRobot's file.
        """
        refuse_strangers(self)
        for index in range(len(self.names)):
            self.check_servo(index)
        refuse_other_calibration(self)
        self.sequential = self._read_in_sync() is None and self._read_in_sync() is None
        refuse_outside(self, self.read().positions)

    def configure(self) -> None:
        """Let LeRobot configure the servos, which switches the torque on; goals are set to the present pose first.

        Raises:
            ArmError: a servo refuses a setting.
        """
        self.line.torque_off()
        for identity, count in zip(self.ids, self.line.read_position(), strict=True):
            self.line.write(identity, self.line.table.goal, int(count))
        self._call_lerobot(self.robot.configure)

    def torque_on(self) -> None:
        """Switch the torque on with the present pose as the goal; raises like `configure`."""
        self.line.hold(self.line.read_position())
        self._call_lerobot(self.bus.enable_torque)

    def command(self, positions: np.ndarray) -> np.ndarray:
        """Send goals through LeRobot.

        Args:
            positions: Goals [rad; m], shape (n,).

        Returns:
            The goals as sent [rad; m], shape (n,): within the limits, in whole counts.

        Raises:
            AdapterLost: the port is gone.
        """
        wanted = convert_to_units(self.bus, self.frame.counts(positions))
        action = {f"{name}.pos": value for name, value in zip(self.names, wanted, strict=True)}
        sent: dict[str, float] = {}
        self.line.port.is_using = False  # a failed transaction may have left it set
        self._call_lerobot(lambda: sent.update(self.robot.send_action(action)))
        values = {motor.id: sent[f"{name}.pos"] for name, motor in self.bus.motors.items()}
        return self.frame.positions(np.array(list(self.bus._unnormalize(values).values())))

    def read(self) -> Reading:
        """Read goal, position, speed and load of every servo in one transaction, or one by one if that fails.

        Raises:
            ArmError: a servo does not answer after several attempts.
        """
        began = self._now()
        answers = None if self.sequential else self._read_in_sync()
        if answers is None:
            self.retries += not self.sequential
            began = self._now()
            answers = self._read_one_by_one()
        return self.reading.decode(answers, (began + self._now()) / 2)

    def refuse_alerts(self, reading: Reading) -> None:
        """Refuse an arm with a servo that has shut down.

        Raises:
            ArmError: a servo has shut down, with the reason.
        """
        for identity in reading.alerts:
            self.check_servo(self.ids.index(identity))

    def check_servo(self, index: int) -> Health:
        """Read voltage, temperature and errors of the servo of joint `index`; raises like `check` if it is unfit."""
        identity = self.ids[index]
        errors = self.line.read(identity, self.control[self._family.errors])
        volts = self.line.read(identity, self.control[self._family.voltage]) * VOLT
        warmth = self.line.read(identity, self.control["Present_Temperature"])
        health = Health(volts, warmth, errors)
        lowest = self.line.read(identity, self.control["Min_Voltage_Limit"]) * VOLT if errors & VOLTAGE else 0.0
        refuse_unfit(self.label(identity), health, lowest)
        return health

    def registers(self) -> dict[str, dict[str, int]]:
        """Read the settings of every servo, by joint and LeRobot's register name; raises like `read`."""
        settings = {name: r for name, r in self.control.items() if not name.startswith(TRANSIENT_REGISTERS)}
        length = max(register.address + register.size for register in settings.values())
        found = {}
        for name, identity in zip(self.names, self.ids, strict=True):
            memory = self.line.read_bytes(identity, 0, length)
            found[name] = {key.strip(): register.decode(memory) for key, register in settings.items()}
        return found

    def read_position(self) -> np.ndarray:
        """Return the present position [counts], shape (n,); see `Line.read_position`."""
        return self.line.read_position()

    def hold(self, position: np.ndarray) -> None:
        """Command a position [counts], shape (n,); see `Line.hold`."""
        self.line.hold(position)

    def speed(self) -> float:
        """Return the speed of the fastest servo [rad/s]."""
        return self.line.speed()

    def torque_off(self) -> None:
        """Switch the torque off at once; see `Line.torque_off`."""
        self.line.torque_off()

    def find_unconfirmed(self) -> list[int]:
        """Return the IDs of servos that do not confirm that their torque is off."""
        return self.line.find_unconfirmed()

    def close(self) -> None:
        """Close the port."""
        self.line.close()

    def describe(self) -> dict[str, object]:
        """Return the description of the hardware for provenance."""
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
        """Return a servo's name for messages: its ID and joint."""
        return f"Servo {identity} ({self.names[self.ids.index(identity)]})"

    def _read_in_sync(self) -> list[bytes] | None:
        return self.line.read_all(self.reading.start, self.reading.size)

    def _read_one_by_one(self) -> list[bytes]:
        try:
            return [self.line.read_bytes(identity, self.reading.start, self.reading.size) for identity in self.ids]
        except ServoSilent:
            if all(self.line.ping(identity) is None for identity in self.ids):
                raise make_no_answer_error(self.bus.port) from None
            raise

    def _wrap_with_retries(self, exchange: Callable[..., object]) -> Callable[..., object]:
        """Wrap a bus function so that it is repeated when a servo does not answer: LeRobot tries only once."""

        def ask(*arguments: object, **options: object) -> object:
            for _ in range(ATTEMPTS - 1):
                try:
                    return exchange(self.bus, *arguments, **options)
                except ConnectionError:
                    self.line.calm()
                    self.line.port.is_using = False
            return exchange(self.bus, *arguments, **options)

        return ask

    def _call_lerobot(self, do: Callable[[], object]) -> None:
        """Call a function of LeRobot, and translate its errors.

        Raises:
            BadReply: a servo did not answer, or answered with an error.
            AdapterLost: the port is gone.
        """
        with report_lost_port(self.bus.port):
            self.line.port.ser.reset_input_buffer()
            try:
                do()
            except DeviceNotConnectedError:
                raise make_lost_port_error(self.bus.port) from None
            except (ConnectionError, RuntimeError) as error:
                if isinstance(error, ArmError):
                    raise
                for index in range(len(self.names)):  # a servo that shut down answers with an error
                    self.check_servo(index)
                reason = " ".join(str(error).split()).rstrip(".")
                raise BadReply(f"LeRobot could not set a servo up or command it: {reason}.") from None


@dataclass(frozen=True, kw_only=True)
class LeRobotDriver:
    """Driver of an arm that LeRobot controls.

    Attributes:
        robot: LeRobot's robot object.
        kind: LeRobot's `--robot.type`.
        frame: Conversion between servo counts and joint positions.
        speed: Speed limit of the commands [rad/s]; 0 for none.
    """

    robot: LeRobot
    kind: str
    frame: Frame
    speed: float = 0.0

    @property
    def bus(self) -> Any:
        """LeRobot's motor bus."""
        return self.robot.bus

    @property
    def port(self) -> str:
        """Path of the port."""
        return str(self.bus.port)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the joints."""
        return self.frame.names

    def open(self, now: Callable[[], float] = time.monotonic) -> LeRobotArm:
        """Open the port; see `LeRobotArm`."""
        return LeRobotArm(self.robot, self.kind, self.frame, now)

    def opener(self) -> ArmOpener:
        """Return how the watchdog opens the arm."""
        ids = [motor.id for motor in self.bus.motors.values()]
        return make_line_opener(find_stop_registers(self.bus), ids, self.port)
