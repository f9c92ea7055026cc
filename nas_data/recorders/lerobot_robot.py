"""LeRobot robots, made from their type and options, on a real or virtual port."""

import contextlib
import importlib
import io
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import draccus
import lerobot.robots
import numpy as np
from lerobot.robots import Robot as LeRobot
from lerobot.robots import RobotConfig, make_robot_from_config

from nas_data.errors import OptionError, UnknownName
from nas_data.hardware.virtual_bus.arm import MountedServo
from nas_data.hardware.virtual_bus.process import VIRTUAL, port_of
from nas_data.hardware.virtual_bus.terminal import Options
from nas_data.joint_units import compute_angle_scales
from nas_data.recorders.lerobot_arm import LeRobotDriver
from nas_data.recorders.lerobot_frame import Frame, compute_frame, compute_full_range, refuse_other_joints
from nas_data.recorders.lerobot_servos import find_family
from nas_data.robots.base import Robot

START_DEVIATION = 0.1  # [rad] by which the virtual arm starts beside its rest pose
SPREAD, STEP = 1001, 317  # [counts] homing offsets of the virtual servos: a different one for each


@dataclass
class ParsedOptions:
    """Target type into which draccus parses LeRobot's options."""

    robot: RobotConfig


@dataclass(frozen=True, kw_only=True)
class RobotRequest:
    """A robot that the user asks for.

    Attributes:
        kind: LeRobot's `--robot.type`.
        options: Its other options by name, without `--robot.`.
        model: Model for the collision checks.
        reverse: Joints whose positive direction is opposite to LeRobot's.
        zero: Joint positions in the model at LeRobot's zero [rad; m].
    """

    kind: str
    options: Mapping[str, str]
    model: Robot
    reverse: Sequence[str] = ()
    zero: Mapping[str, float] | None = None


@contextmanager
def driver_of(
    request: RobotRequest,
    port: str,
    effects: Sequence[str] = (),
    faults: Sequence[str] = (),
    lockstep: bool = False,
    rate: float = 50.0,
    speed: float = 0.0,
) -> Iterator[LeRobotDriver]:
    """Yield the driver of an arm on a real port, or on a virtual one that lives as long as the context.

    Args:
        request: The robot.
        port: Path of the port, or `virtual`.
        effects: Effects of the virtual arm that its model lacks.
        faults: Faults of the virtual arm.
        lockstep: Whether the virtual arm runs as fast as it can instead of in real time.
        rate: Control rate in lock-step [Hz].
        speed: Speed limit of the commands [rad/s]; 0 for none.

    Raises:
        OptionError: LeRobot has no such robot or option, it is not calibrated, or nas cannot record it.
        JointMismatch: the model has other joints.
    """
    if port != VIRTUAL:
        with port_of(port, effects, faults, lockstep) as path:
            robot = make_robot(request, path)
            refuse_uncalibrated(robot, request.kind, path)
            yield LeRobotDriver(robot=robot, kind=request.kind, frame=_make_frame(request, robot), speed=speed)
        return
    with tempfile.TemporaryDirectory() as folder:
        options = {**request.options, "calibration_dir": folder}
        robot = make_robot(request, VIRTUAL, options)
        arm = calibrate_virtual_arm(request, robot, 1 / rate)
        with port_of(VIRTUAL, effects, faults, lockstep, arm) as path:
            calibrated = make_robot(request, path, options)
            calibrated.calibration = calibrated.bus.calibration = robot.calibration
            yield LeRobotDriver(
                robot=calibrated, kind=request.kind, frame=_make_frame(request, calibrated), speed=speed
            )


def calibrate_virtual_arm(request: RobotRequest, robot: LeRobot, period: float) -> Options:
    """Calibrate a virtual robot, and return the options of its virtual bus.

    Raises:
        UnknownName: one of its motors cannot be simulated.
        JointMismatch: the model has other joints.
    """
    bus = robot.bus
    names = tuple(bus.motors)
    turn = max(bus.model_resolution_table[motor.model] for motor in bus.motors.values())
    offsets = [index * STEP % SPREAD - SPREAD // 2 for index in range(1, len(names) + 1)]
    refuse_other_joints(request.model, names)
    known = compute_full_range(request.model, names, turn, offsets)
    for name, motor in bus.motors.items():
        known[name].id = motor.id
    robot.calibration = bus.calibration = known
    frame = _make_frame(request, robot)
    mounted = []
    for index, (name, motor) in enumerate(bus.motors.items()):
        calibration, size = known[name], bus.model_ctrl_table[motor.model]["Homing_Offset"][1]
        encoded = bus._encode_sign("Homing_Offset", {motor.id: calibration.homing_offset})[motor.id]
        counted = (
            1 if find_family(bus).sdk == "scservo_sdk" else -1
        )  # Feetech subtracts the homing offset, Dynamixel adds it
        registers = {
            "homing_offset": encoded % 256**size,
            "lowest_position": calibration.range_min,
            "highest_position": calibration.range_max,
        }
        zero = float(frame.zeros[index]) + counted * calibration.homing_offset
        mounted.append(
            MountedServo(
                joint=name,
                kind=motor.model.replace("-", "_"),
                id=motor.id,
                zero=zero,
                sign=1 if frame.ticks[index] > 0 else -1,
                registers=registers,
            )
        )
    rest = dict(zip(request.model.joints, request.model.rest, strict=False))
    aside = START_DEVIATION * compute_angle_scales(names, frame.slides, frame.high - frame.low)
    pose = np.clip(aside + [rest.get(name, 0.0) for name in names], frame.low, frame.high)
    path = str(request.model.mjcf.absolute())
    return Options(model=path, mounted=tuple(mounted), lying=tuple(pose.tolist()), period=period)


def make_robot(request: RobotRequest, port: str, options: Mapping[str, str] | None = None) -> LeRobot:
    """Create LeRobot's robot object; no port is opened.

    Raises:
        OptionError: LeRobot has no such robot or option, or nas cannot record it.
    """
    _register(request.kind)
    if request.kind not in RobotConfig.get_known_choices():
        known = sorted({*RobotConfig.get_known_choices(), "so101_follower", "so100_follower", "koch_follower"})
        raise OptionError(f"LeRobot has no robot '{request.kind}'; give --robot.type, one of: {', '.join(known)} ….")
    given = {**(request.options if options is None else options), "port": port}
    output = io.StringIO()
    try:
        with contextlib.redirect_stderr(output), contextlib.redirect_stdout(output):
            arguments = [f"--robot.{name}={value}" for name, value in {"type": request.kind, **given}.items()]
            robot = make_robot_from_config(draccus.parse(config_class=ParsedOptions, args=arguments).robot)
    except SystemExit:
        refused = _last(output.getvalue())
        raise OptionError(f"LeRobot does not take these options of a {request.kind}: {refused}.") from None
    except (draccus.utils.DraccusException, ValueError, TypeError, ImportError) as error:
        raise OptionError(f"LeRobot cannot make a {request.kind}: {_last(str(error))}.") from None
    _refuse_other_robots(request, robot)
    return robot


def refuse_uncalibrated(robot: LeRobot, kind: str, port: str) -> None:
    """Refuse a robot that has no calibration.

    Raises:
        OptionError: it has none, or that of another arm.
    """
    names = set(robot.bus.motors)
    if set(robot.calibration) != names:
        raise OptionError(
            f"There is no calibration of this arm at {robot.calibration_fpath}; calibrate it: lerobot-calibrate "
            f"--robot.type={kind} --robot.port={port} --robot.id={robot.id or 'NAME'}, and give "
            "the same --robot.id here."
        )


def default_model(kind: str, model: str | None) -> Robot:
    """Return the given model, or the built-in one of a robot type.

    Raises:
        OptionError: no model is given, and there is no built-in one.
        ModelFileError: the file cannot be used as a model.
    """
    from nas_data.robots.base import find_robot

    try:
        return find_robot(model or kind)
    except UnknownName:
        if model:
            raise
        raise OptionError(
            f"nas has no model of a {kind}, which is needed to avoid collisions; give one whose joints are named as "
            "LeRobot's motors: --model MODEL.xml."
        ) from None


def _make_frame(request: RobotRequest, robot: LeRobot) -> Frame:
    return compute_frame(request.model, robot.bus, robot.calibration, request.reverse, request.zero)


def _register(kind: str) -> None:
    """Import the module that registers a robot type with LeRobot: one of its own, else the installed plug-ins."""
    for file in Path(lerobot.robots.__path__[0]).glob("*/config*.py"):
        if f'"{kind}"' in file.read_text(encoding="utf-8"):
            importlib.import_module(f"lerobot.robots.{file.parent.name}")
    if kind not in RobotConfig.get_known_choices():
        from lerobot.utils.import_utils import register_third_party_plugins

        register_third_party_plugins()


def _refuse_other_robots(request: RobotRequest, robot: LeRobot) -> None:
    """Refuse a robot that is not an arm on one serial bus, or that has cameras."""
    bus = getattr(robot, "bus", None)
    if bus is None or not hasattr(bus, "model_ctrl_table"):
        raise OptionError(
            f"A {request.kind} is not an arm on one bus of Feetech or Dynamixel servos, such as so101_follower, "
            "so100_follower, koch_follower; record it with lerobot-record, and import the recording with nas import."
        )
    if getattr(robot, "cameras", None):
        raise OptionError("nas records joints, not pictures; leave --robot.cameras out.")
    find_family(bus)


def _last(text: str) -> str:
    lines = [" ".join(line.split()) for line in text.splitlines() if line.strip()]
    return lines[-1].rstrip(".") if lines else "no reason given"
