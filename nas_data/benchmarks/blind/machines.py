"""Machines of one to three axes, hinges and slides in any order, each driven by a motor that is told its torque."""

import mujoco
import numpy as np

from nas_data.benchmarks.blind.arms import JointDrive, Link, NominalArm, Style, to_mjcf
from nas_data.benchmarks.blind.designs import draw_log_uniform, format_numbers
from nas_data.benchmarks.blind.following import find_reach
from nas_data.benchmarks.blind.motions import FARTHEST, draw_sines

JOINTS = (1, 3)
LENGTH = (0.15, 0.4)  # [m] of what turns
MASS = (0.3, 2.0)  # [kg] of a link or carriage, lighter towards the tip
ROTOR = (0.2, 0.6)  # rotor's over carried inertia
SPARE = (1.1, 1.8)  # torque limit over the largest torque of a motion without friction
LOST = (0.01, 0.03)  # of the torque limit: the model's own dry friction, and its viscous friction at a usual speed
USUAL = np.array([2.0, 0.5])  # [rad/s], [m/s] usual speeds of hinges and slides
TIMESTEPS = (0.00025, 0.0005)  # [s] a model runs ahead by half of one: at 1 m/s by as much as its sensors' noise
TRIAL = np.arange(0, 8, 0.01)  # [s] motion by which the motors are chosen


def draw_machine(rng: np.random.Generator) -> NominalArm:
    """Draw a machine: hinges that hang under gravity, or stand upright, and slides along any axis."""
    count = int(rng.integers(JOINTS[0], JOINTS[1] + 1))
    sliding = rng.random(count) < 0.5
    joints = tuple(f"{'slide' if slides else 'hinge'}{row + 1}" for row, slides in enumerate(sliding))
    links = draw_axes(rng, sliding)
    style = Style(float(rng.choice(TIMESTEPS)), str(rng.choice(["Euler", "implicitfast"])), "motor", None)
    motors = draw_motors(rng, to_mjcf(joints, links, [], style), sliding)
    return NominalArm("machine", to_mjcf(joints, links, motors, style), joints)


def draw_axes(rng: np.random.Generator, sliding: np.ndarray) -> list[Link]:
    """Draw links; no two slides along one axis, whose friction and inertia no motion could tell apart."""
    hanging = rng.random() < 0.5
    onward = np.array([0.0, 0.0, -1.0]) if hanging else np.array([1.0, 0.0, 0.0])
    free = list(rng.permutation(3))
    mass, links = draw_log_uniform(rng, *MASS), list[Link]()
    place: np.ndarray = np.zeros(3)
    for slides in sliding:
        length = 0.05 if slides else float(rng.uniform(*LENGTH))
        axis = free.pop() if slides else int(rng.integers(2)) if hanging else 2
        centre = length * (onward * rng.uniform(0.4, 0.6) + rng.uniform(-0.1, 0.1, 3))
        size = f"{0.1 * length:.5f} {0.1 * length:.5f} {0.1 * length:.5f}"
        geom = f'type="box" size="{size}" pos="{format_numbers(centre)}" mass="{mass:.6g}"'
        links.append(
            Link(format_numbers(place), format_numbers(np.eye(3)[axis] * rng.choice([-1, 1])), geom, bool(slides))
        )
        mass, place = mass * rng.uniform(0.4, 0.9), length * onward
    return links


def draw_motors(rng: np.random.Generator, bare: str, sliding: np.ndarray) -> list[JointDrive]:
    """Draw motors that are strong enough for motions of the usual speed; half the machines have no friction."""
    model = mujoco.MjModel.from_xml_string(bare)
    inertias, motion = compute_inverse_dynamics(model, rng, find_reach(sliding)[:, 1])
    frictional, motors = bool(rng.random() < 0.5), []
    for row, slides in enumerate(sliding.astype(int)):
        armature = inertias[row] * rng.uniform(*ROTOR)
        torque = motion[0][:, row] + armature * motion[1][:, row]
        limit = float(np.abs(torque).max() * rng.uniform(*SPARE))
        dry, viscous = frictional * rng.uniform(*LOST, 2) * limit
        motors.append(JointDrive(0.0, 0.0, limit, armature, viscous / USUAL[slides], dry))
    return motors


def compute_inverse_dynamics(
    model: mujoco.MjModel, rng: np.random.Generator, reach: np.ndarray
) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray]]:
    """Return what a motion within reach (n,) [rad] asks of a machine without motors.

    Returns:
        Mean inertias [kg m²], shape (n,); torques [N m] and accelerations [rad/s²], shape (T, n) each.
    """
    data, mass = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    positions = np.stack([draw_sines(TRIAL, rng)[0] for _ in reach], axis=1) * reach / FARTHEST
    speeds = np.gradient(positions, TRIAL, axis=0)
    accelerations = np.gradient(speeds, TRIAL, axis=0)
    inertias, torques = [], []
    for q, v, a in zip(positions, speeds, accelerations, strict=True):
        data.qpos[:], data.qvel[:], data.qacc[:] = q, v, a
        mujoco.mj_inverse(model, data)
        mujoco.mj_fullM(model, data, mass)
        inertias.append(np.diag(mass).copy())
        torques.append(data.qfrc_inverse.copy())
    return np.mean(inertias, axis=0), (np.array(torques), accelerations)
