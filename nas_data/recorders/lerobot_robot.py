"""LeRobot's robots by their type and options, on a real port or on a virtual one."""

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
from nas_data.hardware.virtual_bus.arm import Mounted
from nas_data.hardware.virtual_bus.options import Options
from nas_data.hardware.virtual_bus.ports import VIRTUAL, port_of
from nas_data.joint_units import radians_at
from nas_data.recorders.lerobot_arm import LeRobotDriver
from nas_data.recorders.lerobot_frame import Frame, frame_of, full_range, refuse_other_joints
from nas_data.recorders.lerobot_servos import family_of
from nas_data.robots.base import Robot

ASIDE = 0.1  # [rad] from its rest as a hand left the virtual arm
SPREAD, STEP = 1001, 317  # counts by which the virtual horns are off: a number of its own for every servo


@dataclass
class Chosen:
    """What draccus reads LeRobot's options into."""

    robot: RobotConfig


@dataclass(frozen=True, kw_only=True)
class Wish:
    """Which robot is meant.

    Attributes:
        kind: LeRobot's `--robot.type`.
        options: Its other options, as LeRobot writes them without `--robot.`, by name.
        model: The model that it is checked with.
        reverse: Joints that turn against what LeRobot takes for forwards.
        zero: Where joints stand in the model when LeRobot says zero [rad; m].
    """

    kind: str
    options: Mapping[str, str]
    model: Robot
    reverse: Sequence[str] = ()
    zero: Mapping[str, float] | None = None


@contextmanager
def driver_of(
    wish: Wish,
    port: str,
    effects: Sequence[str] = (),
    faults: Sequence[str] = (),
    lockstep: bool = False,
    rate: float = 50.0,
    speed: float = 0.0,
) -> Iterator[LeRobotDriver]:
    """Yield the driver of an arm on a port, or on a virtual one for as long as it is used.

    Args:
        wish: Which robot.
        port: Its path, or `virtual`.
        effects: What the virtual arm has and its model lacks.
        faults: What goes wrong on it.
        lockstep: Whether it moves and answers as fast as it can.
        rate: Control rate [Hz], for lock-step.
        speed: Speed that commands are limited to [rad/s]; 0 for none.

    Raises:
        OptionError: LeRobot has no such robot or option, it is not calibrated, or nas cannot record it.
        JointMismatch: the model has other joints.
    """
    if port != VIRTUAL:
        with port_of(port, effects, faults, lockstep) as path:
            robot = make_robot(wish, path)
            refuse_uncalibrated(robot, wish.kind, path)
            yield LeRobotDriver(robot=robot, kind=wish.kind, frame=_frame(wish, robot), speed=speed)
        return
    with tempfile.TemporaryDirectory() as folder:
        options = {**wish.options, "calibration_dir": folder}
        robot = make_robot(wish, VIRTUAL, options)
        arm = virtual_arm(wish, robot, 1 / rate)
        with port_of(VIRTUAL, effects, faults, lockstep, arm) as path:
            calibrated = make_robot(wish, path, options)
            calibrated.calibration = calibrated.bus.calibration = robot.calibration
            yield LeRobotDriver(robot=calibrated, kind=wish.kind, frame=_frame(wish, calibrated), speed=speed)


def virtual_arm(wish: Wish, robot: LeRobot, period: float) -> Options:
    """Calibrate a robot that does not exist, and return what makes it exist.

    Raises:
        UnknownName: one of its motors cannot be simulated.
        JointMismatch: the model has other joints.
    """
    bus = robot.bus
    names = tuple(bus.motors)
    turn = max(bus.model_resolution_table[motor.model] for motor in bus.motors.values())
    offsets = [place * STEP % SPREAD - SPREAD // 2 for place in range(1, len(names) + 1)]
    refuse_other_joints(wish.model, names)
    known = full_range(wish.model, names, turn, offsets)
    for name, motor in bus.motors.items():
        known[name].id = motor.id
    robot.calibration = bus.calibration = known
    frame = _frame(wish, robot)
    mounted = []
    for place, (name, motor) in enumerate(bus.motors.items()):
        calibration, size = known[name], bus.model_ctrl_table[motor.model]["Homing_Offset"][1]
        encoded = bus._encode_sign("Homing_Offset", {motor.id: calibration.homing_offset})[motor.id]
        counted = (
            1 if family_of(bus).sdk == "scservo_sdk" else -1
        )  # a Feetech takes its offset off, a Dynamixel adds it
        registers = {
            "homing_offset": encoded % 256**size,
            "lowest_position": calibration.range_min,
            "highest_position": calibration.range_max,
        }
        zero = float(frame.zeros[place]) + counted * calibration.homing_offset
        mounted.append(
            Mounted(
                joint=name,
                kind=motor.model.replace("-", "_"),
                id=motor.id,
                zero=zero,
                sign=1 if frame.ticks[place] > 0 else -1,
                registers=registers,
            )
        )
    rest = dict(zip(wish.model.joints, wish.model.rest, strict=False))
    aside = ASIDE * radians_at(names, frame.slides, frame.high - frame.low)
    lying = np.clip(aside + [rest.get(name, 0.0) for name in names], frame.low, frame.high)
    path = str(wish.model.mjcf.absolute())
    return Options(model=path, mounted=tuple(mounted), lying=tuple(lying.tolist()), period=period)


def make_robot(wish: Wish, port: str, options: Mapping[str, str] | None = None) -> LeRobot:
    """Make LeRobot's robot; nothing is opened.

    Raises:
        OptionError: LeRobot has no such robot or option, or nas cannot record it.
    """
    _register(wish.kind)
    if wish.kind not in RobotConfig.get_known_choices():
        raise OptionError(
            f"LeRobot has no robot '{wish.kind}'; give --robot.type, one of: "
            f"{', '.join(sorted(RobotConfig.get_known_choices()))}, so101_follower, so100_follower, koch_follower …."
        )
    given = {**(wish.options if options is None else options), "port": port}
    said = io.StringIO()
    try:
        with contextlib.redirect_stderr(said), contextlib.redirect_stdout(said):
            arguments = [f"--robot.{name}={value}" for name, value in {"type": wish.kind, **given}.items()]
            robot = make_robot_from_config(draccus.parse(config_class=Chosen, args=arguments).robot)
    except SystemExit:
        raise OptionError(f"LeRobot does not take these options of a {wish.kind}: {_last(said.getvalue())}.") from None
    except (draccus.utils.DraccusException, ValueError, TypeError, ImportError) as error:
        raise OptionError(f"LeRobot cannot make a {wish.kind}: {_last(str(error))}.") from None
    _refuse_other_robots(wish, robot)
    return robot


def refuse_uncalibrated(robot: LeRobot, kind: str, port: str) -> None:
    """Refuse a robot that has no calibration.

    Raises:
        OptionError: it has none, or one of another arm.
    """
    names = set(robot.bus.motors)
    if set(robot.calibration) != names:
        raise OptionError(
            f"There is no calibration of this arm at {robot.calibration_fpath}; calibrate it: lerobot-calibrate "
            f"--robot.type={kind} --robot.port={port} --robot.id={robot.id or 'NAME'}, and give "
            "the same --robot.id here."
        )


def default_model(kind: str, model: str | None) -> Robot:
    """Return the model of a robot: the one that is given, or ours of its name.

    Raises:
        OptionError: none is given, and we have none.
        ModelFileError: the file cannot be used as a model.
    """
    from nas_data.robots.base import find_robot

    try:
        return find_robot(model or kind)
    except UnknownName:
        if model:
            raise
        raise OptionError(
            f"nas has no model of a {kind}, without which nobody knows what it would touch; give one whose joints are "
            "named as LeRobot's motors: --model MODEL.xml."
        ) from None


def _frame(wish: Wish, robot: LeRobot) -> Frame:
    return frame_of(wish.model, robot.bus, robot.calibration, wish.reverse, wish.zero)


def _register(kind: str) -> None:
    """Import what tells LeRobot of a robot: its own package that names it, else the plug-ins that are installed."""
    for file in Path(lerobot.robots.__path__[0]).glob("*/config*.py"):
        if f'"{kind}"' in file.read_text(encoding="utf-8"):
            importlib.import_module(f"lerobot.robots.{file.parent.name}")
    if kind not in RobotConfig.get_known_choices():
        from lerobot.utils.import_utils import register_third_party_plugins

        register_third_party_plugins()


def _refuse_other_robots(wish: Wish, robot: LeRobot) -> None:
    """Refuse what is no arm on one serial line."""
    bus = getattr(robot, "bus", None)
    if bus is None or not hasattr(bus, "model_ctrl_table"):
        raise OptionError(
            f"A {wish.kind} is no arm on one line of Feetech or Dynamixel servos, such as so101_follower, "
            "so100_follower, koch_follower; record it with lerobot-record and take it in with nas import."
        )
    if getattr(robot, "cameras", None):
        raise OptionError("nas records joints, not pictures; leave --robot.cameras out.")
    family_of(bus)


def _last(text: str) -> str:
    lines = [" ".join(line.split()) for line in text.splitlines() if line.strip()]
    return lines[-1].rstrip(".") if lines else "no reason given"
