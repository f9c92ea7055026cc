"""Partial gravity compensation by the controller."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import ClassVar

import mujoco

from nas_data.effects.base import Effect, Parameter, Scales
from nas_data.robots.base import list_actuated_joints, list_arm_joints


@dataclass(frozen=True, kw_only=True)
class GravityCompensation(Effect):
    """The controller adds torques that compensate a share of the gravity of all links, with what they carry."""

    share: float

    parameters: ClassVar = (Parameter("share", "", 0.0, 1.0, 0.0),)
    whole_arm: ClassVar = True
    per_joint: ClassVar = False
    edit_order: ClassVar = 1
    equation: ClassVar = "τ = share · g(q)"
    source: ClassVar = "Siciliano, Sciavicco, Villani and Oriolo, Robotics (2009), section 8.5; MuJoCo's gravcomp"
    signature: ClassVar = "All joints sag less than the model by the same share, at every posture and speed."
    confused_with: ClassVar = ("payload", "servo_stiffness", "base_tilt")

    @classmethod
    def guesses(cls, scales: Scales) -> tuple[Mapping[str, float], ...]:
        """Half of gravity; the error is proportional to the share."""
        return ({"share": 0.5},)

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Compensate this share of the gravity that the model does not compensate already."""
        others = set(list_actuated_joints(spec)) - set(list_arm_joints(spec))
        for body in spec.bodies[1:]:
            if is_carried(body, others):
                body.gravcomp += self.share * (1.0 - body.gravcomp)


def is_carried(body: mujoco.MjsBody, others: Collection[str]) -> bool:
    """Whether the arm carries a body: no free joint, as of an object, and no joint of another arm moves it."""
    loose = (mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtJoint.mjJNT_BALL)
    own = not any(joint.type in loose or joint.name in others for joint in body.joints)
    return own and (body.parent is None or is_carried(body.parent, others))
