"""Elements that an effect adds, as the engine alone would have them: nothing of the model's default classes."""

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
    """Undo what a default class gives to a joint that was added: springs, losses, limits, rotor inertia."""
    forget(joint, mujoco.MjSpec().worldbody.add_body().add_joint(), JOINT)


def clear_tendon(tendon: mujoco.MjsTendon) -> None:
    """Undo what a default class gives to a tendon that was added, so that it has no mechanics of its own."""
    forget(tendon, mujoco.MjSpec().add_tendon(), TENDON)


def forget(element: Element, pristine: Element, fields: tuple[str, ...]) -> None:
    """Give an element the fields of one that has no default class, and no limits."""
    for field in fields:
        setattr(element, field, getattr(pristine, field))
    element.limited = element.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE
