"""Zero offsets in LeRobot's calibration file, which has id, drive_mode, homing_offset and range by motor."""

import json
import os
from pathlib import Path

import numpy as np

from nas_data.dataset.staging import write_synced
from nas_data.errors import OptionError
from nas_data.hardware.xl320.joints import Joints
from nas_data.hardware.xl320.units import CENTRE

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
    """Return the zero offsets [ticks] of an arm that is in its zero pose.

    Args:
        joints: The arm's joints.
        raw: Readings of the servos [ticks], shape (n,).

    Raises:
        OptionError: an offset is too large: a horn was mounted wrongly, or the arm is not in its zero pose.
    """
    offsets = CENTRE - raw
    far = np.flatnonzero(np.abs(offsets) > REACH)
    if len(far):
        raise OptionError(
            f"{joints.names[far[0]]} stands {abs(int(offsets[far[0]]))} ticks from its middle; put the arm into its "
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
            f"{path} is no calibration of this arm ({error}); make one with nas robot ergojr --port PORT --calibrate."
        ) from None
    expected = [(identity, int(not direct)) for identity, direct in zip(joints.ids, joints.direct, strict=True)]
    if [number[:2] for number in numbers] != expected:
        raise OptionError(f"{path} has other identities or directions than this arm; calibrate it again.")
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
