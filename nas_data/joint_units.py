"""The units of joints: radians and newton metres for hinges, metres and newtons for slides, never in one figure."""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class JointUnit:
    """In what the positions of one kind of joint are computed and shown.

    Attributes:
        kind: What such joints are called.
        si: Unit inside, and in files.
        shown: Unit in tables.
        mark: What follows a number in a sentence.
        factor: Shown unit per unit inside.
    """

    kind: str
    si: str
    shown: str
    mark: str
    factor: float

    def text(self, value: float, digits: int = 2) -> str:
        """Return a position or an error as a sentence says it."""
        return f"{self.factor * value:.{digits}f}{self.mark}"


HINGE = JointUnit("hinges", "rad", "deg", "°", 180 / math.pi)
SLIDE = JointUnit("slides", "m", "mm", " mm", 1e3)
# Of a figure over joints of both kinds: each error over the spread of the positions of its kind.
SHARE = JointUnit("joints", "1", "%", " %", 100.0)
USUAL_RANGE = math.pi  # [rad] range of a usual hinge, for which thresholds and sizes of angles and speeds are made
SHORTEST = 0.01  # [m] range below which a slide's readings are noise rather than travel
# What an angle's unit becomes where the joint is a slide.
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
    """Return the unit that a quantity with this unit at a hinge has at a joint; ratios, seconds and masses keep it."""
    return OF_SLIDES.get(unit, unit) if slide else unit


def find_display_unit(si: str) -> JointUnit:
    """Return how positions in a unit inside are shown."""
    return next((unit for unit in (SLIDE, SHARE) if unit.si == si), HINGE)


def find_joint_unit(joint: str, slides: Collection[str]) -> JointUnit:
    """Return the unit of a joint's positions.

    Args:
        joint: Its name.
        slides: Names of the joints that are slides.
    """
    return SLIDE if joint in slides else HINGE


def group_by_kind(joints: Sequence[str], slides: Collection[str]) -> list[tuple[JointUnit, np.ndarray]]:
    """Return the kinds of joints that an arm has, hinges first, each with the places of its joints.

    Errors of both kinds are never averaged: a figure over all joints is one of the first kind, with a second figure
    beside it where the arm has both.
    """
    is_slide = np.array([joint in slides for joint in joints], bool)
    found = ((HINGE, np.flatnonzero(~is_slide)), (SLIDE, np.flatnonzero(is_slide)))
    return [(unit, places) for unit, places in found if len(places)] or [(HINGE, np.arange(len(joints)))]


def average_by_kind(values: np.ndarray, joints: Sequence[str], slides: Collection[str]) -> np.ndarray:
    """Return for each joint the mean of a quantity over the joints of its kind, shape (n,).

    Errors over such a scale have no unit, so that a slide's and a hinge's count alike. Among joints of one kind they
    rank as they do without, and a joint that hardly moves does not rule.

    Args:
        values: Spread or noise of each joint [rad; slides m], shape (n,).
        joints: Names of the n joints.
        slides: Names of those that are slides.
    """
    means = np.empty(len(joints))
    for _, places in group_by_kind(joints, slides):
        means[places] = values[places].mean()
    return means


def compute_angle_scales(joints: Sequence[str], slides: Collection[str], reach: np.ndarray) -> np.ndarray:
    """Return what stands for a radian at each joint [rad; slides m], shape (n,): sizes of angles are times this.

    It is 1 at hinges. A slide's range stands for that of a usual hinge.

    Args:
        joints: Names of the n joints.
        slides: Names of those that are slides.
        reach: Range of each joint [rad; slides m], shape (n,); those of hinges do not count.
    """
    is_slide = np.array([joint in slides for joint in joints], bool)
    return np.where(is_slide, np.maximum(reach, SHORTEST) / USUAL_RANGE, 1.0)


def format_table_unit(joints: Sequence[str], slides: Collection[str]) -> str:
    """Return what stands in the head of a table with a figure for each joint, for example `deg; gripper mm`."""
    kinds = group_by_kind(joints, slides)
    if len(kinds) == 1:
        return kinds[0][0].shown
    return f"{HINGE.shown}; {', '.join(joints[place] for place in kinds[1][1])} {SLIDE.shown}"


def list_unit_factors(joints: Sequence[str], slides: Collection[str]) -> np.ndarray:
    """Return the shown unit per unit inside of each joint, shape (n,)."""
    return np.array([find_joint_unit(joint, slides).factor for joint in joints])
