"""The nominal arms of the benchmark: the Ergo Jr, or six random joints of its size."""

from dataclasses import dataclass

import mujoco
import numpy as np

from nas_data.robots.base import find_robot

JOINTS = 6
GRAVITY = 9.81  # [m/s²]
TIMESTEP = 0.002  # [s]
RANGE = 1.57  # [rad] of commands, either way
# Rhoban/bam's XL-320 (m1), about which the servos of random arms are drawn
GAIN, LIMIT = 0.336, 0.208  # [N m/rad], [N m]
ARMATURE, FRICTION = 0.00112, 0.0275  # [kg m²], [N m]
SPARE = 2.5  # torque limit over the largest gravity torque: a servo that is weaker than its arm is no design
WIDTH = 0.024  # [m] of a link's box, that of an XL-320


@dataclass(frozen=True)
class NominalArm:
    """A nominal arm."""

    name: str  # what it is called in the dataset
    xml: str  # plain MJCF: serial, no contacts, no joint limits, a servo or motor and a sensor `<joint>.pos` each
    joints: tuple[str, ...]  # names from the base on

    def spec(self) -> mujoco.MjSpec:
        """Return a fresh, editable model."""
        return mujoco.MjSpec.from_string(self.xml)

    def model(self) -> mujoco.MjModel:
        """Return the compiled model."""
        return self.spec().compile()


def draw_arm(rng: np.random.Generator) -> NominalArm:
    """Return the Ergo Jr in half of all draws, else a random arm."""
    return build_ergojr() if rng.random() < 0.5 else draw_random_arm(rng)


def build_ergojr() -> NominalArm:
    """Return the Ergo Jr without floor, contacts and joint limits, which no plant has."""
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
    """Return joints with random axes, lengths, masses and servos, each servo strong enough for its place."""
    axes = draw_axes(rng, count)
    lengths = np.exp(rng.uniform(np.log(0.03), np.log(0.12), count))
    masses = rng.uniform(0.008, 0.022, count)
    beyond = [compute_gravity_and_inertia(lengths[link:], masses[link:]) for link in range(count)]
    servos = [draw_servo(rng, torque, inertia) for torque, inertia in beyond]
    joints = tuple(f"j{number}" for number in range(1, count + 1))
    return NominalArm("random_arm", format_mjcf(joints, axes, lengths, masses, servos), joints)


def draw_axes(rng: np.random.Generator, count: int) -> list[int]:
    """Draw which axis each joint turns about (0 x, 1 y, 2 z); the first upright or not, no three alike in a row."""
    axes = [int(rng.choice([2, 2, 1]))]
    while len(axes) < count:
        axis = int(rng.choice([0, 1, 2], p=[0.4, 0.4, 0.2]))
        if axes[-2:] != [axis, axis]:
            axes.append(axis)
    return axes


def compute_gravity_and_inertia(lengths: np.ndarray, masses: np.ndarray) -> tuple[float, float]:
    """Return the gravity torque [N m] and inertia [kg m²] about the first joint of links stretched out level."""
    centres = np.cumsum(lengths) - lengths / 2
    return float(GRAVITY * (masses * centres).sum()), float((masses * (centres**2 + lengths**2 / 12)).sum())


def draw_servo(rng: np.random.Generator, torque: float, inertia: float) -> dict[str, float]:
    """Draw a servo: an XL-320 give or take, scaled up where the arm beyond it needs more."""
    scale = max(1.0, SPARE * torque / LIMIT)
    drawn = dict(zip(("gain", "limit", "armature", "friction"), rng.uniform(0.75, 1.35, 4).tolist(), strict=True))
    gain, armature = GAIN * scale * drawn["gain"], ARMATURE * scale * drawn["armature"]
    loss = 2 * rng.uniform(0.6, 1.1) * float(np.sqrt(gain * (armature + inertia / 2)))
    own = float(rng.choice([0.0, rng.uniform(0.3, 0.8)]))  # part of the damping that is the servo's
    return {
        "kp": gain,
        "kv": own * loss,
        "limit": LIMIT * scale * drawn["limit"],
        "armature": armature,
        "damping": (1 - own) * loss,
        "friction": FRICTION * scale * drawn["friction"],
    }


def format_mjcf(
    joints: tuple[str, ...], axes: list[int], lengths: np.ndarray, masses: np.ndarray, servos: list[dict[str, float]]
) -> str:
    """Write a random arm: links along z, the first joint 5 cm above the base."""
    opened, closed = "", ""
    below = 0.05
    for name, axis, length, mass, drive in zip(joints, axes, lengths, masses, servos, strict=True):
        direction = " ".join("1" if index == axis else "0" for index in range(3))
        opened += (
            f'<body name="link_{name}" pos="0 0 {below:.5f}">'
            f'<joint name="{name}" axis="{direction}" damping="{drive["damping"]:.6g}" '
            f'armature="{drive["armature"]:.6g}" frictionloss="{drive["friction"]:.6g}" '
            f'solimpfriction="0.99 0.99 0.001" solreffriction="{2 * TIMESTEP} 1"/>'
            f'<geom type="box" size="{WIDTH / 2} {WIDTH / 2} {length / 2:.5f}" pos="0.004 0.003 {length / 2:.5f}" '
            f'mass="{mass:.6g}" contype="0" conaffinity="0"/>'
        )
        closed += "</body>"
        below = float(length)
    drives = "".join(
        f'<position name="{name}" joint="{name}" kp="{drive["kp"]:.6g}" kv="{drive["kv"]:.6g}" '
        f'forcerange="{-drive["limit"]:.6g} {drive["limit"]:.6g}" ctrlrange="{-RANGE} {RANGE}"/>'
        for name, drive in zip(joints, servos, strict=True)
    )
    sensors = "".join(f'<jointpos name="{name}.pos" joint="{name}"/>' for name in joints)
    return (
        f'<mujoco model="arm"><compiler angle="radian" autolimits="true"/>'
        f'<option timestep="{TIMESTEP}" integrator="implicitfast" gravity="0 0 {-GRAVITY}"/>'
        f"<worldbody>{opened}{closed}</worldbody>"
        f"<actuator>{drives}</actuator><sensor>{sensors}</sensor></mujoco>"
    )
