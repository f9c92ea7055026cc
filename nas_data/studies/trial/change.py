"""Known changes of an arm: how each is made, and as which effect it should be named."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from nas_data.effects.base import Effect, find_effect, make_effect
from nas_data.errors import OptionError
from nas_data.joint_units import convert_hinge_unit

Quantity = Literal["gain", "torque", "speed", "punch", "period", "radian", "mass"]


class ChangeNotMade(Exception):
    """A change cannot be made on this arm; the message is the reason."""


@dataclass(frozen=True, kw_only=True)
class TestedArm:
    """What the sizes of changes are relative to.

    Attributes:
        joints: Names of the n joints.
        period: Control period [s].
        limits: Torque limit of each joint in the baseline's model [N·m; slides N], infinite for none, shape (n,).
        torques: Large torque of each joint in the baseline's recording, at most the limit [N·m; N], shape (n,).
        speeds: Large speed of each joint in the baseline's recording [rad/s; m/s], shape (n,).
        radians: Equivalent of a radian at each joint [rad; m], shape (n,); see `joint_units.compute_angle_scales`.
        slides: Names of the slides.
        mass: Mass that is hung on the last link [kg]; 0 for none.
        loaded: Last joint of the arm on which it is hung; None for a robot with one arm.
    """

    __test__ = False  # no test class of pytest

    joints: tuple[str, ...]
    period: float
    limits: np.ndarray
    torques: np.ndarray
    speeds: np.ndarray
    radians: np.ndarray
    slides: Collection[str] = ()
    mass: float
    loaded: str | None = None

    def measure(self, quantity: Quantity, joint: int) -> float:
        """Return the unit of a change's size [SI]: a quantity of the joint of an index."""
        units: Mapping[str, float] = {
            "gain": 1.0,
            "torque": float(self.torques[joint]),
            "speed": float(self.speeds[joint]),
            "punch": float(self.limits[joint]),
            "period": self.period,
            "radian": float(self.radians[joint]),
            "mass": self.mass,
        }
        return units[quantity]


@dataclass(frozen=True, kw_only=True)
class KnownChange:
    """One change of an arm, of known size.

    Attributes:
        name: Name of its recording.
        does: What is changed, in a few words.
        effect: Effect as which it should be named.
        parameter: Parameter of the effect that has the size.
        joint: Number of the joint, from 0; in an arm of fewer joints, counting begins again. None for the whole arm.
        size: Size of the change, as a multiple of the quantity.
        of: Quantity of the arm that is the unit of the size.
        register: Register of the XL-320 that makes the change; empty for a change that is made otherwise.
    """

    name: str
    does: str
    effect: str
    parameter: str
    joint: int | None
    size: float
    of: Quantity
    register: str = ""

    def find_unit(self, slide: bool) -> str:
        """Return the SI unit of the size, at a hinge or a slide."""
        unit = next(one.unit for one in find_effect(self.effect).parameters if one.name == self.parameter)
        return convert_hinge_unit(unit, slide)

    def expect(self, arm: TestedArm) -> Effect:
        """Return the effect as which the change should be named, with its size.

        Raises:
            ChangeNotMade: the size is a multiple of a torque limit that the model lacks, or the effect cannot have it.
        """
        index = 0 if self.joint is None else self.joint % len(arm.joints)
        whole = arm.loaded if find_effect(self.effect).per_link else None
        joint = whole if self.joint is None else arm.joints[index]
        size = self.size * arm.measure(self.of, index)
        if np.isinf(size):
            raise ChangeNotMade(f"the baseline's model has no torque limit in {joint}")
        try:
            return make_effect(self.effect, joint, {self.parameter: size})
        except OptionError as error:
            where = f" in {joint}" if joint else ""
            raise ChangeNotMade(f"its size is out of range{where}. {error}") from None


# Each is large enough to be seen in a minute of slow motion, and small enough to be safe. They are spread over joints.
CHANGES = (
    KnownChange(
        name="soft", does="position gain halved", effect="servo_stiffness", parameter="factor",
        joint=1, size=0.5, of="gain", register="p_gain",
    ),
    KnownChange(
        name="stiff", does="position gain doubled", effect="servo_stiffness", parameter="factor",
        joint=4, size=2.0, of="gain", register="p_gain",
    ),
    KnownChange(
        name="weak", does="torque limit lowered", effect="torque_limit", parameter="torque",
        joint=2, size=0.7, of="torque", register="torque_limit",
    ),
    KnownChange(
        name="slow_base", does="goal speed limited", effect="speed_limit", parameter="speed",
        joint=0, size=0.5, of="speed", register="moving_speed",
    ),
    KnownChange(
        name="slow_elbow", does="goal speed limited", effect="speed_limit", parameter="speed",
        joint=3, size=0.4, of="speed", register="moving_speed",
    ),
    KnownChange(
        name="punch", does="punch raised", effect="start_torque", parameter="torque",
        joint=1, size=0.15, of="punch", register="punch",
    ),
    KnownChange(
        name="late", does="commands delayed by three control periods", effect="command_delay", parameter="delay",
        joint=None, size=3.0, of="period",
    ),
    KnownChange(
        name="shifted", does="calibration shifted between goals and readings", effect="joint_offset",
        parameter="offset", joint=5, size=0.06, of="radian",
    ),
    KnownChange(
        name="loaded", does="mass hung on the last link", effect="payload", parameter="mass",
        joint=None, size=1.0, of="mass",
    ),
)  # fmt: skip
