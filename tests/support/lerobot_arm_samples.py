"""Virtual arms that LeRobot drives, for tests: they answer at once, and move with the goals instead of by the clock."""

import inspect
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest

from nas_data.hardware.arms.line import open_line
from nas_data.hardware.virtual_bus.process import VirtualBus
from nas_data.hardware.virtual_bus.terminal import Options
from nas_data.recorders.lerobot_arm import LeRobotDriver
from nas_data.recorders.lerobot_frame import compute_frame
from nas_data.recorders.lerobot_robot import RobotRequest, calibrate_virtual_arm, make_robot
from nas_data.robots.base import find_robot

ROBOT = find_robot("so101_follower")
PERIOD = 0.02


def read_sources_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Keep the source of each class: LeRobot's parser reads it anew for every option, two seconds a robot."""
    monkeypatch.setattr(inspect, "getsource", cache(inspect.getsource))


def request(folder: Path, kind: str = "so101_follower", **options: str) -> RobotRequest:
    """Return a robot whose calibration lies in a folder."""
    return RobotRequest(kind=kind, options={"id": "test", "calibration_dir": str(folder), **options}, model=ROBOT)


def arm_of(folder: Path, kind: str = "so101_follower") -> Options:
    """Calibrate a virtual arm: write LeRobot's file, return what it is started with."""
    robot = make_robot(request(folder, kind), "virtual")
    options = calibrate_virtual_arm(request(folder, kind), robot, PERIOD)
    robot._save_calibration()
    return options


@contextmanager
def virtual(folder: Path, *faults: str, kind: str = "so101_follower", **changes: object) -> Iterator[VirtualBus]:
    """Yield a virtual arm in its own process; its calibration lies in the folder."""
    chosen = {"faults": faults, "wire_delay": False, "lockstep": True, **changes}
    with VirtualBus(replace(arm_of(folder, kind), **chosen)) as bus:
        yield bus


def driver(folder: Path, port: str, kind: str = "so101_follower", **options: str) -> LeRobotDriver:
    """Return the driver of such an arm."""
    robot = make_robot(request(folder, kind, **options), port)
    return LeRobotDriver(robot=robot, kind=kind, frame=compute_frame(ROBOT, robot.bus, robot.calibration))


def torques(known: LeRobotDriver) -> list[int]:
    """Read the torque of every servo by another program's eyes."""
    line = open_line(**known.opener().arguments)
    try:
        return [line.read(identity, line.table.torque) for identity in line.ids]
    finally:
        line.close()
