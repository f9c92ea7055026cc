"""Reset of added elements to MuJoCo's defaults, without the model's default classes."""

from typing import TypeAlias

import mujoco

COMMON = (
    "stiffness",
    "damping",
    "springyield",
    "frictionloss",
    "armature",
    "range",
    "actfrcrange",
    "margin",
    "solref_limit",
    "solimp_limit",
    "solref_friction",
    "solimp_friction",
    "group",
)
JOINT = (*COMMON, "ref", "springref", "springdamper", "actgravcomp", "align")
TENDON = (*COMMON, "springlength", "width", "material", "rgba")

Element: TypeAlias = mujoco.MjsJoint | mujoco.MjsTendon


def clear_joint(joint: mujoco.MjsJoint) -> None:
    """Reset the springs, losses, limits and armature of an added joint to MuJoCo's defaults."""
    reset_fields(joint, mujoco.MjSpec().worldbody.add_body().add_joint(), JOINT)


def clear_tendon(tendon: mujoco.MjsTendon) -> None:
    """Reset the springs, losses and limits of an added tendon to MuJoCo's defaults."""
    reset_fields(tendon, mujoco.MjSpec().add_tendon(), TENDON)


def reset_fields(element: Element, pristine: Element, fields: tuple[str, ...]) -> None:
    """Copy fields from an element without a default class, and remove limits."""
    for field in fields:
        setattr(element, field, getattr(pristine, field))
    element.limited = element.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE
