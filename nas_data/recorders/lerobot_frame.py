"""Conversion between LeRobot's motors and a model's joints: zero, sign and unit from LeRobot's calibration."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from lerobot.motors import MotorCalibration, MotorNormMode
from lerobot.motors.motors_bus import SerialMotorsBus

from nas_data.dataset.features import POSITION
from nas_data.errors import JointMismatch, OptionError
from nas_data.robots.base import Robot, list_slide_joints
from nas_data.simulators.limits import command_limits, find_excitable_limits


@dataclass(frozen=True)
class Frame:
    """Conversion between servo counts and joint positions; all arrays have the shape (n,).

    A servo's zero is the middle of its calibrated range, where LeRobot's degrees and −100 … 100 are zero. It
    corresponds to the middle of the joint's range in the model, or to zero if the servo can make a whole turn. The 0 of
    a gripper in 0 … 100 corresponds to its lowest position.

    Attributes:
        names: Names of the joints.
        zeros: Counts at which the joints are at zero.
        ticks: Joint travel per count [rad; m]; negative if joint and servo turn in opposite directions.
        low: Lowest positions that may be commanded [rad; m].
        high: Highest positions that may be commanded [rad; m].
        slides: Names of the slide joints.
    """

    names: tuple[str, ...]
    zeros: np.ndarray
    ticks: np.ndarray
    low: np.ndarray
    high: np.ndarray
    slides: tuple[str, ...] = ()

    def positions(self, counts: np.ndarray) -> np.ndarray:
        """Return positions [rad; m] for counts, shape (n,)."""
        return np.asarray((counts - self.zeros) * self.ticks)

    def counts(self, positions: np.ndarray) -> np.ndarray:
        """Return the nearest counts for positions [rad; m] within the limits, shape (n,)."""
        return np.rint(np.clip(positions, self.low, self.high) / self.ticks + self.zeros).astype(int)


def compute_frame(
    robot: Robot,
    bus: SerialMotorsBus,
    calibration: Mapping[str, MotorCalibration],
    reverse: Sequence[str] = (),
    zero: Mapping[str, float] | None = None,
) -> Frame:
    """Return the frame of a calibrated arm.

    Args:
        robot: The model; its joints have the motors' names.
        bus: The arm's motors.
        calibration: Calibration of each motor.
        reverse: Joints whose positive direction is opposite to LeRobot's.
        zero: Joint positions in the model at LeRobot's zero [rad; m].

    Raises:
        JointMismatch: the model lacks a motor's joint, or an option names an unknown joint.
        OptionError: the ranges of calibration and model have nothing in common.
    """
    names, zero = tuple(bus.motors), zero or {}
    for joint in (*reverse, *zero):
        if joint not in names:
            raise JointMismatch(f"The arm has no joint '{joint}'; it has: {', '.join(names)}.")
    refuse_other_joints(robot, names)
    low, high, slides = compute_model_limits(robot, names)
    zeros, ticks = np.empty(len(names)), np.empty(len(names))
    for index, name in enumerate(names):
        known, motor = calibration[name], bus.motors[name]
        turn = bus.model_resolution_table[motor.model]
        span = known.range_max - known.range_min
        backwards = bool(bus.apply_drive_mode and known.drive_mode) != (name in reverse)
        unit = (high[index] - low[index]) / span if name in slides else 2 * math.pi / turn
        ticks[index] = -unit if backwards else unit
        if motor.norm_mode is MotorNormMode.RANGE_0_100:
            at, there = (known.range_max if backwards else known.range_min), low[index]
        else:
            at = (known.range_min + known.range_max) / 2
            there = 0.0 if span >= turn - 1 else (low[index] + high[index]) / 2
        zeros[index] = at - zero.get(name, there) / ticks[index]
    ends = np.array([[calibration[name].range_min, calibration[name].range_max] for name in names]).T
    first, last = np.sort((ends - zeros) * ticks, axis=0)
    for name, apart in zip(names, np.maximum(low, first) >= np.minimum(high, last), strict=True):
        if apart:
            raise OptionError(
                f"The calibrated range of '{name}' lies outside the model's; check --zero {name}=POSITION (in rad, of "
                f"slides in m) and --reverse {name}, or calibrate the arm again."
            )
    return Frame(names, zeros, ticks, np.maximum(low, first), np.minimum(high, last), slides)


def compute_model_limits(robot: Robot, names: Sequence[str]) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    """Return the lowest and highest positions of a model's joints [rad; m], shape (n,) each, and which are slides."""
    spec = robot.spec()
    slides = list_slide_joints(spec)
    low, high = command_limits(spec.compile(), names, robot.name)
    return *find_excitable_limits(low, high, names, [POSITION] * len(names), slides), slides


def refuse_other_joints(robot: Robot, names: Sequence[str]) -> None:
    """Refuse a model that lacks the joint of a motor.

    Raises:
        JointMismatch: a joint is missing.
    """
    missing = [name for name in names if name not in robot.joints]
    if missing:
        raise JointMismatch(
            f"{robot.mjcf.name} has no actuated joint '{missing[0]}'; rename its joints as LeRobot names the motors: "
            f"{', '.join(names)}."
        )


def compute_full_range(
    robot: Robot, names: Sequence[str], turn: int, offsets: Sequence[int]
) -> dict[str, MotorCalibration]:
    """Return the calibration that LeRobot would find by moving every joint through the model's range.

    Args:
        robot: The model.
        names: Names of its joints.
        turn: Counts per turn.
        offsets: Homing offsets of the servos [counts].

    Raises:
        OptionError: a joint can turn farther than a servo counts.
    """
    low, high, slides = compute_model_limits(robot, names)
    found = {}
    for index, name in enumerate(names):
        half = turn // 4 if name in slides else math.floor((high[index] - low[index]) / 2 / (2 * math.pi / turn))
        middle = (turn - 1) // 2
        if half > middle:
            raise OptionError(f"{name} turns farther in the model than a servo can; give it a range below a turn.")
        found[name] = MotorCalibration(index + 1, 0, offsets[index], middle - half, middle + half)
    return found
