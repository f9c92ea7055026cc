"""Joints and their servos: ID, direction, zero and limits, and the conversion between ticks and radians."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from nas_data.hardware.xl320.units import CENTRE, HIGHEST, LOAD_UNIT, SPEED_UNIT, TICK, decode_sign_magnitude


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
