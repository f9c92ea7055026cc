"""Nominal arms as MJCF: arbitrary serial arms, and those of the XL-320's size (the Ergo Jr or random joints)."""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from nas_data.robots.base import find_robot

JOINTS = 6
GRAVITY = 9.81  # [m/s²]
TIMESTEP = 0.002  # [s]
RANGE = 1.57  # [rad] half range of commands
# Rhoban/bam's XL-320 (m1); the servos of random arms are drawn around it
GAIN, LIMIT = 0.336, 0.208  # [N m/rad], [N m]
ARMATURE, FRICTION = 0.00112, 0.0275  # [kg m²], [N m]
SPARE = 2.5  # torque limit over the largest gravity torque: a servo must hold its own arm
WIDTH = 0.024  # [m] of a link's box, that of an XL-320


@dataclass(frozen=True)
class NominalArm:
    """A nominal arm."""

    name: str  # name in the dataset
    xml: str  # plain MJCF: serial, no contacts, no joint limits, a servo or motor and a sensor `<joint>.pos` each
    joints: tuple[str, ...]  # names from the base on

    def spec(self) -> mujoco.MjSpec:
        """Return a fresh, editable model."""
        return mujoco.MjSpec.from_string(self.xml)

    def model(self) -> mujoco.MjModel:
        """Return the compiled model."""
        return self.spec().compile()


@dataclass(frozen=True)
class Link:
    """A link and the joint that carries it, as MJCF attributes."""

    place: str  # position of its joint in the parent link's frame [m]
    axis: str  # axis of its joint
    geom: str  # attributes of its shape: type, size [m], position of its centre [m], mass [kg]
    sliding: bool = False  # whether its joint slides rather than turns


@dataclass(frozen=True)
class JointDrive:
    """A joint's drive."""

    gain: float  # position gain [N m/rad]
    own: float  # damping inside the servo, subject to its torque limit [N m s/rad]
    limit: float  # largest torque [N m]
    armature: float  # reflected inertia [kg m²]
    damping: float  # of the joint [N m s/rad]
    friction: float  # Coulomb friction [N m]


@dataclass(frozen=True)
class Style:
    """How a model is written in MJCF."""

    timestep: float  # [s]
    integrator: str  # MuJoCo's name of it
    spelling: str  # `position`, `general` or, for torques, `motor`
    control: float | None  # half range of commanded positions [rad]; None for no range
    suffix: str = "_servo"  # an actuator's name is its joint's with this suffix


def to_mjcf(joints: Sequence[str], links: Sequence[Link], servos: Sequence[JointDrive], style: Style) -> str:
    """Write an arm as MJCF; without actuators if `servos` is empty."""
    bodies = ""
    for row in reversed(range(len(joints))):
        drive = format_joint_attributes(servos[row], style) if servos else ""
        kind = ' type="slide"' if links[row].sliding else ""
        bodies = (
            f'<body name="link_{joints[row]}" pos="{links[row].place}">'
            f'<joint name="{joints[row]}" axis="{links[row].axis}"{kind}{drive}/>'
            f'<geom {links[row].geom} contype="0" conaffinity="0"/>{bodies}</body>'
        )
    drives = "".join(format_actuator(joint, servo, style) for joint, servo in zip(joints, servos, strict=False))
    sensors = "".join(f'<jointpos name="{joint}.pos" joint="{joint}"/>' for joint in joints)
    return (
        f'<mujoco model="arm"><compiler angle="radian" autolimits="true"/>'
        f'<option timestep="{style.timestep}" integrator="{style.integrator}" gravity="0 0 {-GRAVITY}"/>'
        f"<worldbody>{bodies}</worldbody><actuator>{drives}</actuator><sensor>{sensors}</sensor></mujoco>"
    )


def format_joint_attributes(servo: JointDrive, style: Style) -> str:
    """Return a joint's attributes; friction is as stiff as the timestep allows, because gears do not creep."""
    return (
        f' damping="{servo.damping:.6g}" armature="{servo.armature:.6g}" frictionloss="{servo.friction:.6g}" '
        f'solimpfriction="0.99 0.99 0.001" solreffriction="{2 * style.timestep} 1"'
    )


def format_actuator(joint: str, servo: JointDrive, style: Style) -> str:
    """Return the MJCF element of a servo or motor."""
    law = {
        "position": f'kp="{servo.gain:.6g}" kv="{servo.own:.6g}"',
        "general": f'gainprm="{servo.gain:.6g}" biastype="affine" biasprm="0 {-servo.gain:.6g} {-servo.own:.6g}"',
        "motor": f'ctrlrange="{-servo.limit:.6g} {servo.limit:.6g}"',
    }[style.spelling]
    ends = "" if style.control is None else f' ctrlrange="{-style.control} {style.control}"'
    force = f'forcerange="{-servo.limit:.6g} {servo.limit:.6g}"'
    return f'<{style.spelling} name="{joint}{style.suffix}" joint="{joint}" {law} {force}{ends}/>'


def draw_arm(rng: np.random.Generator) -> NominalArm:
    """Return the Ergo Jr or, with equal probability, a random arm."""
    return build_ergojr() if rng.random() < 0.5 else draw_random_arm(rng)


def build_ergojr() -> NominalArm:
    """Return the Ergo Jr without floor, contacts and joint limits, which the plants do not model."""
    robot = find_robot("ergojr")
    spec = robot.spec()
    for geom in list(spec.geoms):
        if geom.contype or geom.conaffinity:
            spec.delete(geom)
    for pair in list(spec.excludes):
        spec.delete(pair)
    for joint in spec.joints:
        joint.limited = mujoco.mjtLimited.mjLIMITED_FALSE
    spec.modelname = "arm"
    spec.compile()
    return NominalArm("ergojr", spec.to_xml(), robot.joints)


def draw_random_arm(rng: np.random.Generator, count: int = JOINTS) -> NominalArm:
    """Draw axes, lengths, masses and servos; each servo can hold the links beyond it."""
    axes = draw_axes(rng, count)
    lengths = np.exp(rng.uniform(np.log(0.03), np.log(0.12), count))
    masses = rng.uniform(0.008, 0.022, count)
    beyond = [compute_gravity_and_inertia(lengths[link:], masses[link:]) for link in range(count)]
    servos = [draw_servo(rng, torque, inertia) for torque, inertia in beyond]
    joints = tuple(f"j{number}" for number in range(1, count + 1))
    places = [0.05, *lengths[:-1]]  # along z: the first joint 5 cm above the base
    links = []
    for place, axis, length, mass in zip(places, axes, lengths, masses, strict=True):
        geom = (
            f'type="box" size="{WIDTH / 2} {WIDTH / 2} {length / 2:.5f}" pos="0.004 0.003 {length / 2:.5f}" '
            f'mass="{mass:.6g}"'
        )
        links.append(Link(f"0 0 {place:.5f}", " ".join("1" if row == axis else "0" for row in range(3)), geom))
    style = Style(TIMESTEP, "implicitfast", "position", RANGE, suffix="")
    return NominalArm("random_arm", to_mjcf(joints, links, servos, style), joints)


def draw_axes(rng: np.random.Generator, count: int) -> list[int]:
    """Draw the axis of each joint (0 x, 1 y, 2 z), with at most two equal axes in a row."""
    axes = [int(rng.choice([2, 2, 1]))]
    while len(axes) < count:
        axis = int(rng.choice([0, 1, 2], p=[0.4, 0.4, 0.2]))
        if axes[-2:] != [axis, axis]:
            axes.append(axis)
    return axes


def compute_gravity_and_inertia(lengths: np.ndarray, masses: np.ndarray) -> tuple[float, float]:
    """Return gravity torque [N m] and inertia [kg m²] of horizontally stretched links about the first joint."""
    centres = np.cumsum(lengths) - lengths / 2
    return float(GRAVITY * (masses * centres).sum()), float((masses * (centres**2 + lengths**2 / 12)).sum())


def draw_servo(rng: np.random.Generator, torque: float, inertia: float) -> JointDrive:
    """Draw a servo near an XL-320, scaled up where the links beyond it need more torque."""
    scale = max(1.0, SPARE * torque / LIMIT)
    gain, limit, armature, friction = rng.uniform(0.75, 1.35, 4).tolist()
    gain, armature = GAIN * scale * gain, ARMATURE * scale * armature
    loss = 2 * rng.uniform(0.6, 1.1) * float(np.sqrt(gain * (armature + inertia / 2)))
    own = float(rng.choice([0.0, rng.uniform(0.3, 0.8)]))  # share of the damping that is inside the servo
    return JointDrive(gain, own * loss, LIMIT * scale * limit, armature, (1 - own) * loss, FRICTION * scale * friction)
