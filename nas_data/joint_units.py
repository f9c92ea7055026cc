"""Units of joints: radians and newton metres for hinges, metres and newtons for slides; never mixed in one figure."""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class JointUnit:
    """Units of the positions of hinges or slides.

    Attributes:
        kind: Name of such joints.
        si: Unit in computations and files.
        shown: Unit in tables.
        mark: Suffix of a number in a sentence.
        factor: Shown unit per SI unit.
    """

    kind: str
    si: str
    shown: str
    mark: str
    factor: float

    def text(self, value: float, digits: int = 2) -> str:
        """Format a position or error for a sentence."""
        return f"{self.factor * value:.{digits}f}{self.mark}"


HINGE = JointUnit("hinges", "rad", "deg", "°", 180 / math.pi)
SLIDE = JointUnit("slides", "m", "mm", " mm", 1e3)
# Figures over joints of both kinds: each error relative to the spread of the positions of its kind.
SHARE = JointUnit("joints", "1", "%", " %", 100.0)
USUAL_RANGE = math.pi  # [rad] range of a typical hinge; thresholds for angles and speeds assume it
SHORTEST = 0.01  # [m] a slide whose readings span less is at rest: they are noise
# Unit at a slide for each unit of angle.
OF_SLIDES = {
    "rad": "m",
    "rad/s": "m/s",
    "rad/s²": "m/s²",
    "N·m": "N",
    "N·m/rad": "N/m",
    "N·m·s/rad": "N·s/m",
    "N·m/(rad·s)": "N/(m·s)",
    "kg·m²": "kg",
}


def convert_hinge_unit(unit: str, slide: bool) -> str:
    """Return a quantity's unit at a joint, given its unit at a hinge; ratios, seconds and masses keep theirs."""
    return OF_SLIDES.get(unit, unit) if slide else unit


def find_display_unit(si: str) -> JointUnit:
    """Return the display unit of positions in an SI unit."""
    return next((unit for unit in (SLIDE, SHARE) if unit.si == si), HINGE)


def find_joint_unit(joint: str, slides: Collection[str]) -> JointUnit:
    """Return the unit of a joint's positions.

    Args:
        joint: Name of the joint.
        slides: Names of the slides.
    """
    return SLIDE if joint in slides else HINGE


def group_by_kind(joints: Sequence[str], slides: Collection[str]) -> list[tuple[JointUnit, np.ndarray]]:
    """Return each kind of joint present, hinges first, with the indices of its joints, shape (k,).

    Errors of both kinds are never averaged. An overall figure is that of the first kind; an arm with both kinds has a
    second figure.
    """
    is_slide = np.array([joint in slides for joint in joints], bool)
    found = ((HINGE, np.flatnonzero(~is_slide)), (SLIDE, np.flatnonzero(is_slide)))
    return [(unit, places) for unit, places in found if len(places)] or [(HINGE, np.arange(len(joints)))]


def average_by_kind(values: np.ndarray, joints: Sequence[str], slides: Collection[str]) -> np.ndarray:
    """Return for each joint the mean of a quantity over the joints of its kind, shape (n,).

    Errors divided by it have no unit, so that slides and hinges have equal weight. Their order among joints of one kind
    is unchanged, and a joint that hardly moves does not dominate.

    Args:
        values: Spread or noise of each joint [rad; slides m], shape (n,).
        joints: Names of the n joints.
        slides: Names of the slides.
    """
    means = np.empty(len(joints))
    for _, places in group_by_kind(joints, slides):
        means[places] = values[places].mean()
    return means


def compute_angle_scales(joints: Sequence[str], slides: Collection[str], reach: np.ndarray) -> np.ndarray:
    """Return the equivalent of a radian at each joint [rad; slides m], shape (n,), to scale thresholds for angles.

    It is 1 at hinges. At a slide, its range is equivalent to that of a typical hinge.

    Args:
        joints: Names of the n joints.
        slides: Names of the slides.
        reach: Range of each joint [rad; slides m], shape (n,); unused for hinges.
    """
    is_slide = np.array([joint in slides for joint in joints], bool)
    return np.where(is_slide, np.maximum(reach, SHORTEST) / USUAL_RANGE, 1.0)


def format_table_unit(joints: Sequence[str], slides: Collection[str]) -> str:
    """Return the unit for the heading of a table with one figure per joint, for example `deg; gripper mm`."""
    kinds = group_by_kind(joints, slides)
    if len(kinds) == 1:
        return kinds[0][0].shown
    return f"{HINGE.shown}; {', '.join(joints[place] for place in kinds[1][1])} {SLIDE.shown}"


def list_unit_factors(joints: Sequence[str], slides: Collection[str]) -> np.ndarray:
    """Return the shown unit per SI unit of each joint, shape (n,)."""
    return np.array([find_joint_unit(joint, slides).factor for joint in joints])
