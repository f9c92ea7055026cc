"""An arm that LeRobot drives, as the recorder uses it: LeRobot's robot commands and sets up, its bus is read whole."""

import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from lerobot.motors import MotorNormMode
from lerobot.motors.motors_bus import SerialMotorsBus
from lerobot.robots import Robot as LeRobot
from lerobot.utils.errors import DeviceNotConnectedError

from nas_data.arms.base import Health, Reading
from nas_data.arms.line import ATTEMPTS, Line, Register, Table, charge, said_where_lost
from nas_data.arms.port_errors import lost, refusal
from nas_data.errors import (
    ArmError,
    BadReply,
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
from nas_data.recorders.lerobot_frame import Frame
from nas_data.xl320.fitness import MARGIN

VOLT = 0.1  # [V] a unit of both makers' voltages
VOLTAGE, OVERHEAT, OVERLOAD = 1, 4, 32  # bits of both makers' hardware errors
TRIES = 3  # looks for a servo, and for a second one of its identity; one answer may come late
FLEETING = ("Present_", "Goal_", "Moving", "Status", "Hardware_Error", "Realtime", "Registered", "Torque_Enable")


@dataclass(frozen=True)
class Family:
    """What LeRobot's control tables do not say of a maker's servos.

    Attributes:
        sdk: Package of the SDK.
        protocol: Version, as the SDK counts.
        speed_unit: Of the speed [rad/s].
        load: Register of the load.
        load_unit: Share of the largest torque.
        load_sign: Its sign bit; −1 for a two's complement.
        voltage: Register of the supply.
        errors: Register of the hardware errors.
    """

    sdk: str
    protocol: float
    speed_unit: float
    load: str
    load_unit: float
    load_sign: int
    voltage: str
    errors: str


FAMILIES = {
    # STS series: counts a second, 0.1 %; source: Feetech's memory table
    "FeetechMotorsBus": Family(
        "scservo_sdk", 0, 2 * np.pi / 4096, "Present_Load", 1e-3, 10, "Present_Voltage", "Status"
    ),
    # X series: 0.229 rev/min, a PWM of 885 is the largest; source: ROBOTIS e-manual
    "DynamixelMotorsBus": Family(
        "dynamixel_sdk",
        2.0,
        0.229 * 2 * np.pi / 60,
        "Present_PWM",
        1 / 885,
        -1,
        "Present_Input_Voltage",
        "Hardware_Error_Status",
    ),
}


class LeRobotArm:
    """An arm on a port.

    Attributes:
        robot: LeRobot's.
        frame: How its servos and the model's joints go together.
        line: Its servos.
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
        self.robot, self.frame, self._kind, self._now = robot, frame, kind, now
        self.bus: SerialMotorsBus = robot.bus
        self.sequential, self.retries = False, 0
        self._registers = {name: register_of(self.bus, name) for name in control_table(self.bus)}
        self._family = family_of(self.bus)
        try:
            self.bus.connect(handshake=False)
        except ConnectionError as error:
            cause = error.__cause__ if isinstance(error.__cause__, OSError | ValueError) else error
            raise refusal(self.bus.port, cause) from None
        self.line = Line(table_of(self.bus), self.ids, self.bus.port_handler, self.bus.packet_handler)
        self.bus.write = self._patiently(type(self.bus).write)
        self.bus.read = self._patiently(type(self.bus).read)
        self._start, self._end = self._stretch()
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
        self._refuse_strangers()
        for place in range(len(self.names)):
            self.look_after(place)
        self._refuse_other_calibration()
        self.sequential = self._sync() is None and self._sync() is None
        self._refuse_outside(self.read().positions)

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
        wanted = self._units(self.frame.counts(positions))
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
        table, errors = self.line.table, self._registers[self._family.errors]
        heard = answers if self._start <= errors.address < self._end else []
        return Reading(
            time=(began + self._now()) / 2,
            positions=self.frame.positions(self._column(table.position)),
            velocities=self._column(table.speed) * table.speed_unit * self._per_radian(),
            loads=self._column(self._registers[self._family.load]) * self._family.load_unit * np.sign(self.frame.ticks),
            raw=b"".join(self._state(answer) for answer in answers),
            alerts=tuple(i for i, data in zip(self.ids, heard, strict=False) if errors.decode(data, self._start)),
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
        errors = self.line.read(identity, self._registers[self._family.errors])
        volts = self.line.read(identity, self._registers[self._family.voltage]) * VOLT
        warmth = self.line.read(identity, self._registers["Present_Temperature"])
        health = Health(volts, warmth, errors)
        lowest = self.line.read(identity, self._registers["Min_Voltage_Limit"]) * VOLT if errors & VOLTAGE else 0.0
        refuse_unfit(self._name(identity), health, lowest)
        return health

    def registers(self) -> dict[str, dict[str, int]]:
        """Read the settings of every servo, by joint and LeRobot's names; raises as `read` does."""
        settings = {name: r for name, r in self._registers.items() if not name.startswith(FLEETING)}
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

    def _name(self, identity: int) -> str:
        return f"Servo {identity} ({self.names[self.ids.index(identity)]})"

    def _stretch(self) -> tuple[int, int]:
        """Return begin and end of what is read every time."""
        table = self.line.table
        wanted = [table.goal, table.position, table.speed, self._registers[self._family.load]]
        errors = self._registers[self._family.errors]
        wanted += [errors] if errors.address > table.position.address else []
        return min(one.address for one in wanted), max(one.address + one.size for one in wanted)

    def _sync(self) -> list[bytes] | None:
        return self.line.read_all(self._start, self._end - self._start)

    def _one_by_one(self) -> list[bytes]:
        try:
            return [self.line.read_bytes(identity, self._start, self._end - self._start) for identity in self.ids]
        except ServoSilent:
            if all(self.line.ping(identity) is None for identity in self.ids):
                raise nobody(self.bus.port) from None
            raise

    def _column(self, register: Register) -> np.ndarray:
        return np.array([register.decode(answer, self._start) for answer in self._last], float)

    def _state(self, answer: bytes) -> bytes:
        """Return what an answer says of the servo's motion, without the goal."""
        return answer[self.line.table.position.address - self._start :]

    def _per_radian(self) -> np.ndarray:
        """Return what the joints turn or slide with a radian of their servos, shape (n,)."""
        turns = [self.bus.model_resolution_table[motor.model] for motor in self.bus.motors.values()]
        return np.asarray(self.frame.ticks * np.array(turns) / (2 * np.pi))

    def _units(self, counts: np.ndarray) -> list[float]:
        """Return what LeRobot has to be told so that it sends these counts: it drops what lies beyond the point."""
        wanted = []
        for name, count in zip(self.names, counts.tolist(), strict=True):
            motor, known = self.bus.motors[name], self.bus.calibration[name]
            within = count + (0.5 if count >= 0 else -0.5)
            if motor.norm_mode is MotorNormMode.DEGREES:
                turn = self.bus.model_resolution_table[motor.model] - 1
                wanted.append((within - (known.range_min + known.range_max) / 2) * 360 / turn)
                continue
            share = (within - known.range_min) / (known.range_max - known.range_min)
            share = 1 - share if self.bus.apply_drive_mode and known.drive_mode else share
            wanted.append(share * 100 if motor.norm_mode is MotorNormMode.RANGE_0_100 else share * 200 - 100)
        return wanted

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
        with said_where_lost(self.bus.port):
            self.line.port.ser.reset_input_buffer()
            try:
                do()
            except DeviceNotConnectedError:
                raise lost(self.bus.port) from None
            except (ConnectionError, RuntimeError) as error:
                if isinstance(error, ArmError):
                    raise
                for place in range(len(self.names)):  # a servo that shut down answers with an error
                    self.look_after(place)
                said = " ".join(str(error).split()).rstrip(".")
                raise BadReply(f"LeRobot could not set a servo up or command it: {said}.") from None

    def _find(self, identity: int) -> int | None:
        """Return the model number of a servo; None where it answers in none of several tries."""
        tries = (self.line.ping(identity) for _ in range(TRIES))
        return next((model for model in tries if model is not None), None)

    def _refuse_strangers(self) -> None:
        found = {identity: self._find(identity) for identity in self.ids}
        here = [identity for identity, model in found.items() if model is not None]
        if not here:
            raise nobody(self.bus.port)
        for identity in here:
            heard = [self.line.voices(identity, self._start, self._end - self._start) for _ in range(TRIES)]
            if 2 * sum(sound > 1 for sound, _ in heard) > TRIES or all(
                damaged and not sound for sound, damaged in heard
            ):
                raise DuplicateId(
                    f"Two servos answer as {identity}; unplug all but one of them and give it its own identity "
                    "(lerobot-setup-motors)."
                )
        missing = [str(identity) for identity in self.ids if identity not in here]
        if missing:
            raise ServoSilent(
                f"Servo {', '.join(missing)} does not answer, {', '.join(map(str, here))} do; check its plug and its "
                "identity (lerobot-setup-motors gives identities)."
            )
        for motor in self.bus.motors.values():
            known = self.bus.model_number_table[motor.model]
            if found[motor.id] != known:
                raise WrongModel(
                    f"{self._name(motor.id)} has model number {found[motor.id]}; a {motor.model} has {known}: exchange "
                    "the servo."
                )

    def _refuse_other_calibration(self) -> None:
        for name, motor in self.bus.motors.items():
            known = self.bus.calibration[name]
            wanted = {"Homing_Offset": known.homing_offset, "Min_Position_Limit": known.range_min}
            wanted["Max_Position_Limit"] = known.range_max
            for register, value in wanted.items():
                held = self.line.read(motor.id, self._registers[register])
                if held != value:
                    raise OptionError(
                        f"{self._name(motor.id)} holds {held} for {register}, its calibration file says {value}; "
                        f"calibrate it again: lerobot-calibrate --robot.type={self._kind} "
                        f"--robot.port={self.bus.port} --robot.id={self.robot.id}."
                    )

    def _refuse_outside(self, positions: np.ndarray) -> None:
        frame = self.frame
        for joint, position, low, high in zip(self.names, positions, frame.low, frame.high, strict=True):
            if not low - MARGIN <= position <= high + MARGIN:
                raise OutsideLimits(
                    f"{joint} stands at {np.degrees(position):.0f}°, outside {np.degrees(low):.0f} … "
                    f"{np.degrees(high):.0f}°; move it there by hand (the torque is off), or calibrate the arm."
                )


def refuse_unfit(name: str, health: Health, lowest: float) -> None:
    """Refuse a servo that shut down.

    Args:
        name: What to call the servo.
        health: What it says.
        lowest: Voltage that it needs [V].

    Raises:
        ServoHot, ServoOverloaded, SupplyLow: it did, for that reason.
    """
    again = "then switch the supply off and on."
    if health.errors & OVERHEAT:
        raise ServoHot(f"{name} shut down at {health.temperature} °C; let it cool, {again}")
    if health.errors & OVERLOAD:
        raise ServoOverloaded(f"{name} shut down by overload; free what blocks it, {again}")
    if health.errors & VOLTAGE:
        raise SupplyLow(
            f"{name} gets {health.voltage:.1f} V and needs {lowest:.1f} V or more, within its limit; check the supply."
        )


def nobody(port: str) -> ArmError:
    """Return what to raise where no servo answers."""
    return NobodyAnswers(
        f"No servo answers on {port}; switch the supply on, check the plug of the first servo, and that it is the "
        "arm's port (lerobot-find-port)."
    )


def family_of(bus: SerialMotorsBus) -> Family:
    """Return whose servos are on a bus.

    Raises:
        OptionError: they are of none that is known.
    """
    for kind in type(bus).__mro__:
        if kind.__name__ in FAMILIES:
            return FAMILIES[kind.__name__]
    raise OptionError(f"{type(bus).__name__} is no line of Feetech or Dynamixel servos, which nas can record.")


def control_table(bus: SerialMotorsBus) -> Mapping[str, tuple[int, int]]:
    """Return the registers that all motors of a bus have in the same place, by LeRobot's names."""
    tables = [bus.model_ctrl_table[motor.model] for motor in bus.motors.values()]
    return {name: place for name, place in tables[0].items() if all(table.get(name) == place for table in tables)}


def register_of(bus: SerialMotorsBus, name: str) -> Register:
    """Return a register with the sign that LeRobot's encoding table gives it."""
    address, size = control_table(bus)[name]
    family = family_of(bus)
    encoded = bus.model_encoding_table.get(next(iter(bus.motors.values())).model) or {}
    if name == family.load:
        return Register(address, size, family.load_sign)
    if name not in encoded:
        return Register(address, size)
    return Register(address, size, -1 if family.load_sign < 0 else encoded[name])


def table_of(bus: SerialMotorsBus) -> Table:
    """Return the registers by which an arm is stopped."""
    family = family_of(bus)
    return Table(
        sdk=family.sdk,
        protocol=family.protocol,
        baud=bus.default_baudrate,
        speed_unit=family.speed_unit,
        torque=register_of(bus, "Torque_Enable"),
        goal=register_of(bus, "Goal_Position"),
        position=register_of(bus, "Present_Position"),
        speed=register_of(bus, "Present_Velocity"),
    )


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
