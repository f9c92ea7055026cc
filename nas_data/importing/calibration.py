"""LeRobot's units, degrees or −100 … 100 of the calibrated range, and their detection.

LeRobot's `MotorsBus._normalize` (0.4.4 and 0.6.1) converts ticks t with range_min and range_max of the calibration:

- degrees: (t − (min + max) / 2) · 360 / (resolution − 1)
- −100 … 100: (t − min) / (max − min) · 200 − 100, with the sign reversed if drive_mode is 1 and the bus applies it
  (Feetech does, Dynamixel does not)
- 0 … 100: likewise, 100 − x if reversed

So −100 … 100 are degrees times a factor per joint, and both are zero in the middle of the calibrated range. LeRobot's
first versions gave degrees as ticks · 360 / resolution, with the zero of another calibration.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from nas_data.dataset.joints import MIN_READINGS, is_on_grid, list_degree_steps
from nas_data.errors import LogError, OptionError
from nas_data.importing.conversion import NORMALISED
from nas_data.importing.map import LogQuantity, Map, ServoTicks

UNITS = ("deg", "range", "rad")
RANGE = "range"  # unit −100 … 100
LARGEST = 100.0  # bound of that unit
CLIPPED = 3  # readings exactly at a value that make it an end of the range
WHERE = "LeRobot keeps it in ~/.cache/huggingface/lerobot/calibration/robots/ROBOT/ID.json"


@dataclass(frozen=True)
class Motor:
    """Calibration of one motor [ticks].

    Attributes:
        low: `range_min`.
        high: `range_max`.
        turned: Whether `drive_mode` is 1.
    """

    low: int
    high: int
    turned: bool


def read_calibration(path: Path) -> dict[str, Motor]:
    """Read LeRobot's calibration file.

    Raises:
        LogError: the file is missing, or no calibration file.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8-sig"))
        return {
            str(name): Motor(int(entry["range_min"]), int(entry["range_max"]), bool(entry["drive_mode"]))
            for name, entry in content.items()
        }
    except FileNotFoundError:
        raise LogError(f"There is no calibration file {path}; {WHERE}.") from None
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        raise LogError(
            f"{path} is not a calibration file of LeRobot, which has drive_mode, range_min and range_max of each "
            "motor; "
            f"{WHERE}."
        ) from None


def read_calibrations(paths: Sequence[Path]) -> dict[str, Motor]:
    """Read the calibration of an arm, or of the arms of a robot: of `ID_left.json`, the motors are `left_…`.

    Raises:
        LogError: a file is missing, or no calibration file.
        OptionError: two files are of one side.
    """
    if len(paths) == 1:
        return read_calibration(paths[0])
    sides = [find_side(path) for path in paths]
    if len(set(sides)) < len(sides):
        raise OptionError(
            f"Several calibration files are of the side '{max(sides, key=sides.count)}'; give one file for each arm, "
            "named ID_left.json and ID_right.json."
        )
    return {
        f"{side}_{name}": motor
        for side, path in zip(sides, paths, strict=True)
        for name, motor in read_calibration(path).items()
    }


def find_side(path: Path) -> str:
    """Return the arm of a calibration file of a robot with several, as in `ID_left.json`."""
    return path.stem.rpartition("_")[2]


def match_motors(mapping: Map, paths: Sequence[Path]) -> list[Motor]:
    """Return the motor of each joint of a map.

    Args:
        mapping: A map of LeRobot datasets.
        paths: Calibration files; see `read_calibrations`. Without one there are no motors.

    Raises:
        LogError: a motor is missing in the calibration, or its range is empty.
    """
    if not paths:
        return []
    calibration, path = read_calibrations(paths), ", ".join(map(str, paths))
    names = [name.removesuffix(".pos") for name in mapping.position.source.names or mapping.joints]
    missing = next((name for name in names if name not in calibration), None)
    if missing is not None:
        two_arms = any(missing.endswith(f"_{motor}") for motor in calibration)
        remedy = (
            "Give the files of all arms of the robot: --calibration ID_left.json --calibration ID_right.json."
            if two_arms
            else "Give this robot's own file."
        )
        raise LogError(f"{path} has no motor '{missing}'; it has: {', '.join(calibration)}. {remedy}")
    empty = next((name for name in names if calibration[name].low >= calibration[name].high), None)
    if empty is not None:
        raise LogError(f"{path} has an empty range for '{empty}'; calibrate the robot again.")
    return [calibration[name] for name in names]


def find_range_middles(mapping: Map, motors: Sequence[Motor]) -> dict[str, float]:
    """Return the map's position of the middle of each calibrated range, LeRobot's zero [rad; m].

    Omitted are joints in 0 … 100, and joints calibrated over a whole turn, whose zero is arbitrary.

    Args:
        mapping: A map of LeRobot datasets.
        motors: Motor of each joint; empty without a calibration.
    """
    servo = mapping.servo or ServoTicks(4096, True)
    conversion, turn = mapping.position.conversion, servo.resolution - 1
    whole = [motor.high - motor.low >= turn for motor in motors] or [False] * len(mapping.joints)
    parts = zip(mapping.joints, conversion.units, conversion.bias, whole, strict=True)
    return {joint: bias for joint, unit, bias, over in parts if unit in {"deg", RANGE} and not over}


def choose_unit(mapping: Map, raw: np.ndarray, motors: Sequence[Motor]) -> tuple[str, str]:
    """Distinguish degrees from −100 … 100 by the readings of joints that are degrees in the map.

    Args:
        mapping: A map whose joints are in degrees.
        raw: Readings as stored, shape (N, n).
        motors: Motor of each joint; empty without a calibration.

    Returns:
        `deg` or `range`, and the reason.

    Raises:
        OptionError: the readings are not degrees, and another unit needs a calibration.
    """
    body = [index for index, unit in enumerate(mapping.position.conversion.units) if unit == "deg"]
    servo = mapping.servo or ServoTicks(4096, True)
    if not body:
        return "deg", "the map says"
    if np.abs(raw[:, body]).max(initial=0.0) > LARGEST + 1e-3:
        return "deg", "readings go beyond 100"
    grids = [[is_on_grid(raw[:, index], step) for index in body] for step in list_degree_steps(servo.resolution)]
    degrees = next((grid for grid in grids if _is_consistent_fit(grid)), grids[0])
    if motors:
        ranges = [is_on_grid(raw[:, index], 200 / (motors[index].high - motors[index].low)) for index in body]
        if _is_consistent_fit(degrees) and not _is_consistent_fit(ranges):
            return "deg", "readings are the servo's ticks in degrees"
        if _is_consistent_fit(ranges):
            return RANGE, "readings are the servo's ticks in −100 … 100"
        return RANGE, "a calibration was given; use --unit deg if they are degrees"
    if _is_consistent_fit(degrees):
        return "deg", "readings are the servo's ticks in degrees"
    ends = any((np.abs(raw[:, index]) == LARGEST).sum() >= CLIPPED for index in body)
    if ends or any(fit is False and _has_step(raw[:, index]) for fit, index in zip(degrees, body, strict=True)):
        raise OptionError(
            "The readings do not fit degrees of these servos (another step, or clipped at 100), so they are taken as "
            f"−100 … 100. These cannot be converted without the calibration: add --calibration FILE ({WHERE}). If they "
            "are degrees or radians, give --unit deg or --unit rad."
        )
    return "deg", "LeRobot's default; use --unit range --calibration FILE if they are −100 … 100"


def with_raw_unit(mapping: Map, unit: str, motors: Sequence[Motor]) -> Map:
    """Return a map that reads another unit instead of degrees, and reverses 0 … 100 of reversed motors.

    In a dataset of radians the normalised joints are radians as well.

    Raises:
        OptionError: the unit is −100 … 100, and there is no calibration.
    """
    if unit == RANGE and not motors:
        raise OptionError(f"--unit range cannot be converted without the calibration: add --calibration FILE; {WHERE}.")
    servo = mapping.servo or ServoTicks(4096, True)

    def converted(quantity: LogQuantity) -> LogQuantity:
        lines = zip(quantity.conversion.gain, quantity.conversion.bias, quantity.conversion.units, strict=True)
        changed = [
            _convert_line(line, unit, servo, motors[index] if motors else None) if kind == "position" else line
            for index, (line, kind) in enumerate(zip(lines, quantity.conversion.kinds, strict=True))
        ]
        gain, bias, units = zip(*changed, strict=True)
        return replace(quantity, conversion=replace(quantity.conversion, gain=gain, bias=bias, units=units))

    return replace(mapping, position=converted(mapping.position), command=converted(mapping.command))


def _convert_line(
    line: tuple[float, float, str], unit: str, servo: ServoTicks, motor: Motor | None
) -> tuple[float, float, str]:
    """Return gain, bias and raw unit of one joint in another unit."""
    gain, bias, held = line
    turned = motor is not None and motor.turned and servo.drive_mode
    if held == NORMALISED and unit == "rad":
        return 1.0, 0.0, unit
    if held == NORMALISED and turned:  # 100 − x has the direction of the servo
        return -gain, bias + LARGEST * gain, held
    if held != "deg" or unit == "deg":
        return line
    if unit == "rad":
        return gain * 180 / np.pi, bias, "rad"
    assert motor is not None
    factor = (motor.high - motor.low) / 200 * 360 / (servo.resolution - 1)
    return gain * factor * (-1 if turned else 1), bias, RANGE


def _has_step(values: np.ndarray) -> bool:
    """Return whether readings have any quantisation step."""
    steps = np.diff(np.unique(values))
    return len(steps) >= MIN_READINGS and bool(np.median(steps) < 1.2 * steps.min())


def _is_consistent_fit(fits: Sequence[bool | None]) -> bool:
    """Return whether all decided joints fit, and at least one is decided."""
    return any(fits) and all(fit is not False for fit in fits)
