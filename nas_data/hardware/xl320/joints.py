"""Joints and their servos: direction, zero, limits, conversion to radians, calibration file; those of the ErgoJr."""

import json
import os
from dataclasses import dataclass, replace
from functools import cache, cached_property
from pathlib import Path

import numpy as np

from nas_data.dataset.staging import write_synced
from nas_data.errors import OptionError
from nas_data.hardware.xl320.control_table import CENTRE, HIGHEST, LOAD_UNIT, SPEED_UNIT, TICK, decode_sign_magnitude


@dataclass(frozen=True)
class Joints:
    """Joints of an arm, one servo each."""

    names: tuple[str, ...]  # names of the joints
    ids: tuple[int, ...]  # IDs of their servos
    direct: tuple[bool, ...]  # whether a joint turns in the direction of its servo
    low: tuple[float, ...]  # lowest positions [rad]
    high: tuple[float, ...]  # highest positions [rad]
    # ticks that are added to a servo's reading, so that the joint's zero is the centre of the range
    offsets: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        if not self.offsets:
            object.__setattr__(self, "offsets", (0,) * len(self.names))

    @cached_property
    def signs(self) -> np.ndarray:
        """1 for a direct joint, −1 for an indirect one, shape (n,)."""
        return np.where(self.direct, 1, -1)

    @cached_property
    def zeros(self) -> np.ndarray:
        """Readings of the servos where the joints are at zero [ticks], shape (n,)."""
        return CENTRE - np.array(self.offsets)

    def positions(self, raw: np.ndarray) -> np.ndarray:
        """Return positions [rad] for readings [ticks], shape (…, n)."""
        return np.asarray(self.signs * (raw - self.zeros) * TICK)

    def velocities(self, raw: np.ndarray) -> np.ndarray:
        """Return velocities [rad/s] for the speed registers, shape (…, n)."""
        return np.asarray(self.signs * decode_sign_magnitude(raw) * SPEED_UNIT)

    def loads(self, raw: np.ndarray) -> np.ndarray:
        """Return loads as shares of the largest torque for the load registers, shape (…, n)."""
        return np.asarray(self.signs * decode_sign_magnitude(raw) * LOAD_UNIT)

    def raw(self, positions: np.ndarray) -> np.ndarray:
        """Return the nearest ticks for positions [rad], shape (n,), even outside the servo's range."""
        return np.rint(self.signs * positions / TICK).astype(int) + self.zeros

    def ticks(self, positions: np.ndarray) -> np.ndarray:
        """Return goals for positions [rad], shape (n,): the nearest ticks within the limits of joints and servos."""
        return np.clip(self.raw(np.clip(positions, self.low, self.high)), 0, HIGHEST)

    def with_offsets(self, offsets: tuple[int, ...]) -> "Joints":
        """Return the joints with other zeros."""
        return replace(self, offsets=offsets)


# Poppy's poppy_ergo_jr.json: IDs 1 to 6, m1 and m4 direct, the others indirect
DIRECT = {"m1": True, "m2": False, "m3": False, "m4": True, "m5": False, "m6": False}


@cache
def make_ergojr_joints(offsets: tuple[int, ...] = ()) -> Joints:
    """Return the joints of the ErgoJr, with the limits of its model and zero offsets [ticks], zero if empty."""
    from nas_data.robots.ergojr import ROBOT
    from nas_data.simulators.limits import command_limits

    low, high = command_limits(ROBOT.spec().compile(), ROBOT.joints, ROBOT.name)
    return Joints(
        names=ROBOT.joints,
        ids=tuple(range(1, len(ROBOT.joints) + 1)),
        direct=tuple(DIRECT[joint] for joint in ROBOT.joints),
        low=tuple(low.tolist()),
        high=tuple(high.tolist()),
        offsets=offsets,
    )


REACH = 150  # [ticks] largest plausible zero offset, 44°; beyond it the horn was mounted wrongly


def default_path(robot: str, name: str) -> Path:
    """Return the path of LeRobot's calibration file for a type of robot and the name of an arm.

    Source: LeRobot 0.4.4, `HF_LEROBOT_CALIBRATION`, else `HF_LEROBOT_HOME/calibration`, else that below `HF_HOME`.
    """
    cache = Path(os.environ.get("HF_HOME", Path(os.environ.get("XDG_CACHE_HOME", "~/.cache")) / "huggingface"))
    home = Path(os.environ.get("HF_LEROBOT_HOME", cache / "lerobot"))
    folder = Path(os.environ.get("HF_LEROBOT_CALIBRATION", home / "calibration"))
    return (folder / "robots" / robot / f"{name}.json").expanduser()


def compute_zero_offsets(joints: Joints, raw: np.ndarray) -> tuple[int, ...]:
    """Return the zero offsets of an arm in its zero pose from the readings of its servos, shape (n,) [ticks].

    Raises:
        OptionError: an offset is too large: a horn was mounted wrongly, or the arm is not in its zero pose.
    """
    offsets = CENTRE - raw
    far = np.flatnonzero(np.abs(offsets) > REACH)
    if len(far):
        raise OptionError(
            f"{joints.names[far[0]]} is {abs(int(offsets[far[0]]))} ticks from its middle; put the arm into its "
            "zero pose (upright, all horns on their marks), or mount the horn again."
        )
    return tuple(offsets.tolist())


def write_calibration(path: Path, joints: Joints) -> None:
    """Write the joints' zeros and limits in LeRobot's format."""
    ends = np.sort([joints.raw(np.array(joints.low)), joints.raw(np.array(joints.high))], axis=0).T
    content = {
        name: {
            "id": joints.ids[index],
            "drive_mode": int(not joints.direct[index]),
            "homing_offset": joints.offsets[index],
            "range_min": int(ends[index][0]),
            "range_max": int(ends[index][1]),
        }
        for index, name in enumerate(joints.names)
    }
    write_synced(path, json.dumps(content, indent=4).encode())


def read_calibration(path: Path, joints: Joints) -> Joints:
    """Return the joints with the zeros of a calibration file.

    Raises:
        OptionError: the file is missing, damaged, or from another arm.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        entries = [content[name] for name in joints.names]
        numbers = [tuple(int(entry[key]) for key in ("id", "drive_mode", "homing_offset")) for entry in entries]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise OptionError(
            f"{path} is not a calibration of this arm ({error}); make one with nas robot ergojr --port PORT "
            "--calibrate."
        ) from None
    expected = [(identity, int(not direct)) for identity, direct in zip(joints.ids, joints.direct, strict=True)]
    if [number[:2] for number in numbers] != expected:
        raise OptionError(f"{path} has other IDs or directions than this arm; calibrate the arm again.")
    return joints.with_offsets(tuple(number[2] for number in numbers))


def find_joints(joints: Joints, robot: str, name: str, path: Path | None = None) -> Joints:
    """Return the joints with the zeros of an arm's calibration; unchanged without a calibration.

    Args:
        joints: Joints of this type of arm.
        robot: Type of the robot.
        name: Name of the arm.
        path: Calibration file; LeRobot's default path if None.

    Raises:
        OptionError: the given file is missing, or the file is damaged or from another arm.
    """
    known = path or default_path(robot, name)
    return read_calibration(known, joints) if path or known.is_file() else joints
