"""A drawn serial arm as MJCF: links, motors or position servos in either of MuJoCo's two spellings, sensors."""

from collections.abc import Sequence
from dataclasses import dataclass

GRAVITY = 9.81  # [m/s²]


@dataclass(frozen=True)
class Link:
    """A link and the joint that carries it, as MJCF has them."""

    place: str  # of its joint in the link before [m]
    axis: str  # of its joint
    geom: str  # attributes of its shape: type, size [m], place of its centre [m], mass [kg]
    sliding: bool = False  # whether its joint slides rather than turns


@dataclass(frozen=True)
class JointDrive:
    """A joint's drive."""

    gain: float  # position gain [N m/rad]
    own: float  # damping of the servo's own, within its saturation [N m s/rad]
    limit: float  # largest torque [N m]
    armature: float  # reflected inertia [kg m²]
    damping: float  # of the joint [N m s/rad]
    friction: float  # Coulomb friction [N m]


@dataclass(frozen=True)
class Style:
    """How a model is written."""

    timestep: float  # [s]
    integrator: str  # MuJoCo's word
    spelling: str  # `position`, `general` or, for torques, `motor`
    control: float | None  # commanded positions' half range [rad]; None for no range


def to_mjcf(joints: Sequence[str], links: Sequence[Link], servos: Sequence[JointDrive], style: Style) -> str:
    """Write an arm; without servos where none are given."""
    bodies = ""
    for row in reversed(range(len(joints))):
        drive = format_joint_attributes(servos[row], style) if servos else ""
        bodies = (
            f'<body name="link_{joints[row]}" pos="{links[row].place}">'
            f'<joint name="{joints[row]}" axis="{links[row].axis}"{format_joint_type(links[row])}{drive}/>'
            f'<geom {links[row].geom} contype="0" conaffinity="0"/>{bodies}</body>'
        )
    drives = "".join(format_actuator(joint, servo, style) for joint, servo in zip(joints, servos, strict=False))
    sensors = "".join(f'<jointpos name="{joint}.pos" joint="{joint}"/>' for joint in joints)
    return (
        f'<mujoco model="arm"><compiler angle="radian" autolimits="true"/>'
        f'<option timestep="{style.timestep}" integrator="{style.integrator}" gravity="0 0 {-GRAVITY}"/>'
        f"<worldbody>{bodies}</worldbody><actuator>{drives}</actuator><sensor>{sensors}</sensor></mujoco>"
    )


def format_joint_type(link: Link) -> str:
    """Return what kind of joint carries a link, where it is no hinge."""
    return ' type="slide"' if link.sliding else ""


def format_joint_attributes(servo: JointDrive, style: Style) -> str:
    """Return a joint's attributes; its friction is as hard as the timestep allows, for gears do not creep."""
    return (
        f' damping="{servo.damping:.6g}" armature="{servo.armature:.6g}" frictionloss="{servo.friction:.6g}" '
        f'solimpfriction="0.99 0.99 0.001" solreffriction="{2 * style.timestep} 1"'
    )


def format_actuator(joint: str, servo: JointDrive, style: Style) -> str:
    """Return a servo or motor, named otherwise than its joint."""
    law = {
        "position": f'kp="{servo.gain:.6g}" kv="{servo.own:.6g}"',
        "general": f'gainprm="{servo.gain:.6g}" biastype="affine" biasprm="0 {-servo.gain:.6g} {-servo.own:.6g}"',
        "motor": f'ctrlrange="{-servo.limit:.6g} {servo.limit:.6g}"',
    }[style.spelling]
    ends = "" if style.control is None else f' ctrlrange="{-style.control} {style.control}"'
    force = f'forcerange="{-servo.limit:.6g} {servo.limit:.6g}"'
    return f'<{style.spelling} name="{joint}_servo" joint="{joint}" {law} {force}{ends}/>'
