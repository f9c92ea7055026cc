"""Features of a dataset: keys, names and units of the contract."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from nas_data.joint_units import convert_hinge_unit

STATE = "observation.state"
ACTION = "action"
NEXT_STATE = "next.observation.state"
SIM_STATE = "next.observation.sim_state"
ENVIRONMENT = "observation.environment_state"
NEXT_ENVIRONMENT = "next.observation.environment_state"
SIM_ENVIRONMENT = "next.observation.sim_environment_state"
REWARD = "next.reward"
DONE = "next.done"
SUCCESS = "next.success"
TIME = "nas.time"

POSITION = ".pos"
VELOCITY = ".vel"
EFFORT = ".effort"

UNITS = {POSITION: "rad", VELOCITY: "rad/s", EFFORT: "N·m"}


@dataclass(frozen=True)
class Feature:
    """One column of a dataset: a vector per frame.

    Attributes:
        names: Name of each component, for example `m1.pos`.
        units: Unit of each component; empty if unknown.
        dtype: NumPy name of the stored type.
    """

    names: tuple[str, ...]
    units: tuple[str, ...] = ()
    dtype: str = "float32"

    @property
    def width(self) -> int:
        """Number of components."""
        return len(self.names)

    def to_info(self) -> dict[str, object]:
        """Return LeRobot's description of this feature (`meta/info.json`), with the unit under `info`."""
        info: dict[str, object] = {"dtype": self.dtype, "shape": [self.width], "names": list(self.names)}
        if self.units:
            info["info"] = {"unit": self.units[0] if len(set(self.units)) == 1 else list(self.units)}
        return info

    @classmethod
    def from_info(cls, key: str, info: Mapping[str, object]) -> "Feature":
        """Read LeRobot's description; names in a dict are flattened, missing ones are generated."""
        shape = info.get("shape") or [1]
        width = int(np.prod(np.asarray(shape)))
        names = info.get("names")
        if isinstance(names, Mapping):
            names = [name for group in names.values() for name in (group if isinstance(group, list) else [group])]
        if not isinstance(names, Sequence) or isinstance(names, str) or len(names) != width:
            names = [key] if width == 1 else [f"{key}.{i}" for i in range(width)]
        extra = info.get("info")
        unit = extra.get("unit") if isinstance(extra, Mapping) else None
        if isinstance(unit, str):
            unit = [unit] * width
        units = tuple(str(item) for item in unit) if isinstance(unit, Sequence) and len(unit) == width else ()
        return cls(names=tuple(str(name) for name in names), units=units, dtype=str(info["dtype"]))


def are_generated(key: str, names: Sequence[str]) -> bool:
    """Return whether the component names of a feature are those that are generated where none are stored."""
    return all(name == key or name.startswith(f"{key}.") for name in names)


def make_joint_feature(joints: Sequence[str], suffixes: Sequence[str], slides: Collection[str] = ()) -> Feature:
    """Return a feature with one component per joint and suffix, in the contract's units.

    Args:
        joints: Names of the joints.
        suffixes: Quantities: `POSITION`, `VELOCITY`, `EFFORT`.
        slides: Names of the slides, in metres and newtons.
    """
    parts = [(joint, suffix) for suffix in suffixes for joint in joints]
    return Feature(
        names=tuple(joint + suffix for joint, suffix in parts),
        units=tuple(convert_hinge_unit(UNITS[suffix], joint in slides) for joint, suffix in parts),
    )


def make_state_feature(joints: Sequence[str], slides: Collection[str] = ()) -> Feature:
    """Positions [rad; m] then velocities [rad/s; m/s] of the joints."""
    return make_joint_feature(joints, (POSITION, VELOCITY), slides)


def make_position_feature(joints: Sequence[str], slides: Collection[str] = ()) -> Feature:
    """Commanded or measured positions [rad; m] of the joints."""
    return make_joint_feature(joints, (POSITION,), slides)


def make_effort_feature(joints: Sequence[str], slides: Collection[str] = ()) -> Feature:
    """Commanded torques [N·m] and forces [N] of the joints."""
    return make_joint_feature(joints, (EFFORT,), slides)


def make_action_feature(joints: Sequence[str], kinds: Sequence[str], slides: Collection[str] = ()) -> Feature:
    """Command of each joint: a position, velocity or torque, by its kind (`.pos`, `.vel`, `.effort`)."""
    parts = list(zip(joints, kinds, strict=True))
    return Feature(
        names=tuple(joint + kind for joint, kind in parts),
        units=tuple(convert_hinge_unit(UNITS[kind], joint in slides) for joint, kind in parts),
    )


def make_time_feature() -> Feature:
    """Seconds since the episode's start by the recorder's clock; float64, which holds microseconds for years."""
    return Feature(names=("time",), units=("s",), dtype="float64")


def flag_feature(key: str) -> Feature:
    """One boolean per frame, with the name that LeRobot gives to unnamed features."""
    return Feature(names=(key,), dtype="bool")


def make_reward_feature() -> Feature:
    """The reward of the step from a frame to the next, in the task's own units."""
    return Feature(names=(REWARD,))
