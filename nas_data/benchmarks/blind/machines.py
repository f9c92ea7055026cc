"""Machines of one to three axes with torque-commanded motors, and a controller that follows references."""

import mujoco
import numpy as np

from nas_data.benchmarks.blind.arms import JointDrive, Link, NominalArm, Style, to_mjcf
from nas_data.benchmarks.blind.case import Base, CommandSequence, Conditions, Script, Truth
from nas_data.benchmarks.blind.designs import draw_log_uniform, format_numbers
from nas_data.benchmarks.blind.motions import FARTHEST, as_stored, draw_sines
from nas_data.benchmarks.blind.plants.base import Play, find_plant, make_chain
from nas_data.benchmarks.blind.plants.constants import Constants
from nas_data.benchmarks.blind.plants.hiding import PlantBody, stack_arms

BANDWIDTH = 2 * np.pi * 3.0  # [rad/s] decay rate of the error: stiff enough to stay in range, too soft to hide friction
HINGE, SLIDE = 0.8, 0.2  # [rad], [m] largest distance of a reference from the middle


def find_reach(sliding: np.ndarray) -> np.ndarray:
    """Return the lowest and highest position of references [rad, m], shape (n, 2); `sliding` has shape (n,)."""
    return np.where(sliding, SLIDE, HINGE)[:, None] * np.array([-1.0, 1.0])


def draw_references(
    conditions: Conditions, episodes: int, reach: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Draw long reference motions, sums of sines, that episodes are cut from.

    Args:
        conditions: Rate and length of an episode, and the number of episodes per motion.
        episodes: Number of episodes E; a multiple of the episodes per motion.
        reach: Lowest and highest position of each joint [rad], shape (n, 2).
        rng: Source of randomness.

    Returns:
        Positions (E / pieces, pieces T, n) and the first of each motion [rad].
    """
    times = np.arange(conditions.pieces * conditions.steps) * conditions.period
    takes = episodes // conditions.pieces
    middle, half = reach.mean(axis=1), np.ptp(reach, axis=1) / 2
    courses = np.array([[draw_sines(times, rng)[0] for _ in half] for _ in range(takes)])
    references = middle + half * courses.swapaxes(1, 2) / FARTHEST
    return references, references[:, 0]


class Follower:
    """Computed-torque control by the nominal model, once per control period; stores its commands.

    torque = M(q) · (a + 2 ω (v − dq/dt) + ω² (r − q)) + bias(q, dq/dt), with a reference r, v, a: Siciliano et al.,
    Robotics, 2009, section 8.5.2.
    """

    def __init__(self, arm: NominalArm, references: np.ndarray, period: float) -> None:
        """Prepare to follow references [rad], shape (E, T, n), at a control period [s]."""
        self.constants = Constants.of(arm.model())
        nominal = PlantBody.of(self.constants, Base.nominal(len(arm.joints)))
        self.chain = make_chain(stack_arms([nominal], len(references)))
        self.references = references
        self.speeds = np.gradient(references, period, axis=1)
        self.accelerations = np.gradient(self.speeds, period, axis=1)
        self.commands = np.zeros_like(references)  # commanded torques [N m], shape (E, T, n)

    def __call__(self, step: int, states: np.ndarray) -> np.ndarray:
        """Return the torques (E, n) [N m] of one control period for states (E, 2n), rounded as they are stored."""
        q, v = np.split(states, 2, axis=1)
        mass, bias = self.chain.dynamics(q, v)
        wanted = (
            self.accelerations[:, step]
            + 2 * BANDWIDTH * (self.speeds[:, step] - v)
            + BANDWIDTH**2 * (self.references[:, step] - q)
        )
        torques = (mass @ wanted[..., None])[..., 0] + self.constants.armature * wanted + bias
        self.commands[:, step] = as_stored(np.clip(torques, *self.constants.control.T))
        return np.asarray(self.commands[:, step])


class FollowingSession:
    """An arm that follows references under a controller, cut into episodes; caches the result for one truth."""

    def __init__(self, arm: NominalArm, conditions: Conditions, references: np.ndarray) -> None:
        """Prepare to follow long references [rad], shape (K, pieces T, n)."""
        self.arm = arm
        self.conditions = conditions
        self.references = references
        self._known: tuple[str, Truth, CommandSequence] | None = None

    def part(self, episodes: slice) -> Script:
        """Return the script of some of the K pieces episodes; all are simulated at once, which costs no more time."""
        return lambda plant, truth: self._make_tape(plant, truth)[episodes]

    def _make_tape(self, plant: str, truth: Truth) -> CommandSequence:
        if self._known is None or self._known[0] != plant or self._known[1] is not truth:
            self._known = plant, truth, follow(find_plant(plant), self.arm, truth, self.references, self.conditions)
        return self._known[2]


def follow(
    play: Play, arm: NominalArm, truth: Truth, references: np.ndarray, conditions: Conditions
) -> CommandSequence:
    """Simulate an arm that follows long references (K, pieces T, n) [rad] and cut the result into K pieces episodes."""
    follower, length = Follower(arm, references, conditions.period), conditions.steps
    at, speeds = references[:, 0], follower.speeds[:, 0]
    states = play(arm, [truth], references, at, conditions.period, 0.0, speeds, follower)[0]
    n, starts = references.shape[2], states[:, :-1:length]
    begins = starts.reshape(-1, 2 * n)
    return CommandSequence(follower.commands.reshape(len(begins), length, n), begins[:, :n], begins[:, n:])


JOINTS = (1, 3)
LENGTH = (0.15, 0.4)  # [m] of rotating links
MASS = (0.3, 2.0)  # [kg] of a link or carriage, lighter towards the tip
ROTOR = (0.2, 0.6)  # rotor inertia over carried inertia
SPARE = (1.1, 1.8)  # torque limit over the largest torque of a frictionless motion
LOST = (0.01, 0.03)  # share of the torque limit: the model's dry friction, and its viscous friction at a typical speed
USUAL = np.array([2.0, 0.5])  # [rad/s], [m/s] typical speeds of hinges and slides
TIMESTEPS = (0.00025, 0.0005)  # [s] integration leads by half a step: at 1 m/s as much as the sensors' noise
TRIAL = np.arange(0, 8, 0.01)  # [s] motion that the motors are sized for


def draw_machine(rng: np.random.Generator) -> NominalArm:
    """Draw a machine: hinges with horizontal or vertical axes, and slides along any axis."""
    count = int(rng.integers(JOINTS[0], JOINTS[1] + 1))
    sliding = rng.random(count) < 0.5
    joints = tuple(f"{'slide' if slides else 'hinge'}{row + 1}" for row, slides in enumerate(sliding))
    links = draw_axes(rng, sliding)
    style = Style(float(rng.choice(TIMESTEPS)), str(rng.choice(["Euler", "implicitfast"])), "motor", None)
    motors = draw_motors(rng, to_mjcf(joints, links, [], style), sliding)
    return NominalArm("machine", to_mjcf(joints, links, motors, style), joints)


def draw_axes(rng: np.random.Generator, sliding: np.ndarray) -> list[Link]:
    """Draw links; no two slides share an axis, because no motion separates their friction and inertia."""
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
    """Draw motors that can drive motions of typical speed; half the machines have no friction."""
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
    """Compute the inertias and torques of a random motion of a machine without motors, within reach (n,) [rad].

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
