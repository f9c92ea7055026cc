"""Linear conversion of log values (degrees, millimetres, ticks, normalised) to SI, per joint."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from nas_data.importing.section import MapSection

Kind = Literal["position", "velocity", "effort", "command", "signal"]
COMMANDS: tuple[Kind, ...] = ("position", "velocity", "effort")  # types of commands

DEGREE = np.pi / 180  # [rad]
TURN = 2 * np.pi  # [rad]
FACTORS: Mapping[Kind, Mapping[str, float]] = {
    "position": {"rad": 1.0, "deg": DEGREE, "turn": TURN, "m": 1.0, "cm": 1e-2, "mm": 1e-3, "ticks": 1.0},
    "velocity": {
        "rad/s": 1.0, "deg/s": DEGREE, "turn/s": TURN, "rpm": TURN / 60,
        "m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3, "ticks": 1.0,
    },
    "effort": {"N·m": 1.0, "N*m": 1.0, "Nm": 1.0, "mN·m": 1e-3, "N": 1.0, "A": 1.0},
    "signal": {},
}  # fmt: skip
FACTORS = {**FACTORS, "command": {unit: factor for kind in COMMANDS for unit, factor in FACTORS[kind].items()}}
SI: Mapping[Kind, str] = {"position": "rad", "velocity": "rad/s", "effort": "N·m"}  # of hinges
OF_SLIDES = {"m", "cm", "mm", "m/s", "cm/s", "mm/s", "N"}
OF_EITHER = {"ticks", "A", "normalised"}  # the map defines them by `scale`, or by `low` and `high`
NORMALISED = "normalised"
SCALED = {"ticks", "A"}  # undefined without `scale`
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "datetime": 1e-9}  # [s]

KEYS = ("unit", "kind", "scale", "zero", "range", "low", "high", "sign", "offset")
UNIT_KEYS = frozenset({"unit", "kind", "scale", "zero", "range", "low", "high"})


@dataclass(frozen=True)
class Conversion:
    """value = gain · raw + bias, one line per component.

    Attributes:
        gain: SI unit per raw unit.
        bias: SI value of raw zero.
        units: Unit of the raw values of each component.
        kinds: Quantity of each component.
        spans: Raw width of the range of each normalised component; 0 for other units.
    """

    gain: tuple[float, ...]
    bias: tuple[float, ...]
    units: tuple[str, ...]
    kinds: tuple[Kind, ...]
    spans: tuple[float, ...]

    def apply(self, raw: np.ndarray) -> np.ndarray:
        """Convert raw values of shape (N, n) to SI."""
        return raw * np.array(self.gain) + np.array(self.bias)

    def raw(self, value: np.ndarray) -> np.ndarray:
        """Convert SI values of shape (N, n) back to raw values."""
        return (value - np.array(self.bias)) / np.array(self.gain)


def parse_conversion(section: MapSection, kind: Kind, joints: Sequence[str]) -> Conversion:
    """Read the conversion keys of a quantity's table; its `joints` sub-tables override them.

    Raises:
        MapError: a unit or joint is unknown, a key is missing, or a list has a wrong length.
    """
    overrides = section.table("joints")
    per_joint = [_read_joint_values(section, index, len(joints)) for index in range(len(joints))]
    lines = []
    for joint, values in zip(joints, per_joint, strict=True):
        override = overrides.table(joint)
        kept = {key: value for key, value in values.items() if not (override.has("unit") and key in UNIT_KEYS)}
        own = f"{section.name}.joints.{joint}"
        # A missing key is reported in the table that has the unit.
        inherited = dict.fromkeys(kept, section.name) | dict.fromkeys(override.values, own)
        one = MapSection(
            {**kept, **override.values}, section.file, own if override.has("unit") else section.name, inherited
        )
        lines.append(_parse_line(one, kind))
        one.finish()
    overrides.finish()
    return Conversion(*zip(*lines, strict=True))


def _read_joint_values(section: MapSection, index: int, count: int) -> dict[str, object]:
    """Return the conversion keys for one joint; lists have one number per joint, except `range`, which is a pair."""
    values: dict[str, object] = {}
    for key in KEYS:
        if key in ("unit", "kind") and isinstance(section.values.get(key), list):
            raise section.error(
                f"'{key}' is a list, but it must be one value for all joints; set that of a single joint in "
                f"[{section.name}.joints.JOINT]."
            )
        if key in ("unit", "kind") and section.has(key):
            values[key] = section.text(key)
        elif key == "range" and section.has(key):
            values[key] = list(section.numbers(key, 2))
        elif section.has(key):
            values[key] = section.numbers(key, count)[index]
    return values


def _parse_line(section: MapSection, kind: Kind) -> tuple[float, float, str, Kind, float]:
    """Return gain, bias, raw unit, kind and raw width of the range of one component."""
    unit = section.text("unit", choices=_list_units(kind))
    if kind == "command":
        kind = _parse_kind(section, unit)
    sign = section.number("sign", 1.0)
    if abs(sign) != 1:
        raise section.error(f"'sign' is {sign:g}; it must be 1 or -1.", "sign")
    offset = section.number("offset", 0.0) if kind == "position" else 0.0
    if unit == NORMALISED:
        gain, bias, span = _read_range(section, kind)
    else:
        (gain, bias), span = _read_scale(section, FACTORS[kind].get(unit, 1.0), unit, kind), 0.0
    return sign * gain, sign * bias + offset, unit, kind, span


def _list_units(kind: Kind) -> tuple[str, ...]:
    """Return the units that a quantity may have."""
    return (*FACTORS[kind], *[NORMALISED] * (kind in ("position", "velocity", "command")))


def _parse_kind(section: MapSection, unit: str) -> Kind:
    """Read the command type: from `kind`, else from the unit; ticks and normalised values are positions."""
    usual = next((kind for kind in COMMANDS if unit in _list_units(kind)), COMMANDS[0])
    kind = next(one for one in COMMANDS if one == section.text("kind", usual, choices=COMMANDS))
    if unit not in _list_units(kind):
        choices = ", ".join(_list_units(kind))
        raise section.error(f"'kind' is '{kind}' but 'unit' is '{unit}'; choose one of: {choices}.", "kind")
    return kind


def _read_scale(section: MapSection, factor: float, unit: str, kind: Kind) -> tuple[float, float]:
    """Read `scale` and `zero`: value = factor · scale · (raw − zero). Ticks and amperes require `scale`."""
    scale = section.number("scale", None if unit in SCALED else 1.0)
    if scale == 0:
        raise section.error("'scale' is 0; it must not be 0.", "scale")
    zero = section.number("zero", None if unit == "ticks" and kind == "position" else 0.0)
    return factor * scale, -factor * scale * zero


def _read_range(section: MapSection, kind: Kind) -> tuple[float, float, float]:
    """Read `range` (raw values at the ends) and `low`, `high` (values at the ends [rad; m]): gain, bias, raw width."""
    first, last = section.numbers("range", 2)
    low, high = section.number("low"), section.number("high")
    if first == last or low == high:
        ends = f"'range' is {first:g} … {last:g} and low, high are {low:g}, {high:g}"
        raise section.error(f"{ends}; ends must differ.", "low" if low == high else "range")
    gain = (high - low) / (last - first)
    return gain, (low - gain * first if kind == "position" else 0.0), abs(last - first)


def check_encoding(section: MapSection) -> str:
    """Read the key `encoding`: sign encoding of a raw register; empty for plain numbers."""
    encoding = section.text("encoding", "")
    if encoding and not re.fullmatch(r"int(8|16|32)|sign_magnitude_([1-9]|[12]\d|30)", encoding):
        raise section.error(
            f"'encoding' is '{encoding}'; choose int8, int16, int32 (two's complement read as unsigned) "
            "or sign_magnitude_B (bit B holds the sign, for example 10 for the XL-320)."
        )
    return encoding


def decode(raw: np.ndarray, encoding: str) -> np.ndarray:
    """Decode a register's sign.

    Args:
        raw: Unsigned counts, any shape.
        encoding: `int16` and the like for two's complement, `sign_magnitude_10` for a sign in bit 10, or empty.
    """
    if not encoding:
        return raw
    if encoding.startswith("int"):
        bits = int(encoding.removeprefix("int"))
        return np.where(raw >= 2 ** (bits - 1), raw - 2.0**bits, raw)
    bit = int(encoding.removeprefix("sign_magnitude_"))
    return np.where(raw >= 2**bit, 2.0**bit - raw, raw)
