"""A controller that follows a smooth reference with torques, and its long motions cut into episodes."""

import numpy as np

from nas_data.benchmarks.blind.arms import NominalArm
from nas_data.benchmarks.blind.case import Base, CommandSequence, Conditions, Script, Truth
from nas_data.benchmarks.blind.motions import FARTHEST, as_stored, draw_sines
from nas_data.benchmarks.blind.plants.base import Play, find_plant, make_chain
from nas_data.benchmarks.blind.plants.constants import Constants
from nas_data.benchmarks.blind.plants.hiding import PlantBody, stack_arms

BANDWIDTH = 2 * np.pi * 3.0  # [rad/s] of the error's decay: stiff enough to stay in range, too soft to hide friction
HINGE, SLIDE = 0.8, 0.2  # [rad], [m] from the middle that a reference goes at most


def find_reach(sliding: np.ndarray) -> np.ndarray:
    """Return the lowest and highest position of references [rad, m], shape (n, 2), for which joints slide, (n,)."""
    return np.where(sliding, SLIDE, HINGE)[:, None] * np.array([-1.0, 1.0])


def draw_references(
    conditions: Conditions, episodes: int, reach: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Draw the long motions that so many episodes are cut from, sums of sines.

    Args:
        conditions: Rate and length of an episode, and into how many pieces a motion is cut.
        episodes: How many, E; a multiple of the pieces.
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
    """Computed-torque control by the nominal model, once a control period; remembers what it told.

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
        self.commands = np.zeros_like(references)  # torques that were told [N m], shape (E, T, n)

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
    """What a controller does with an arm that follows references, cut into episodes; remembers it for one truth."""

    def __init__(self, arm: NominalArm, conditions: Conditions, references: np.ndarray) -> None:
        """Prepare to follow long references [rad], shape (K, pieces T, n)."""
        self.arm = arm
        self.conditions = conditions
        self.references = references
        self._known: tuple[str, Truth, CommandSequence] | None = None

    def part(self, episodes: slice) -> Script:
        """Return the script of some of the K pieces episodes; all are played at once, for that takes no longer."""
        return lambda plant, truth: self._make_tape(plant, truth)[episodes]

    def _make_tape(self, plant: str, truth: Truth) -> CommandSequence:
        if self._known is None or self._known[0] != plant or self._known[1] is not truth:
            self._known = plant, truth, follow(find_plant(plant), self.arm, truth, self.references, self.conditions)
        return self._known[2]


def follow(
    play: Play, arm: NominalArm, truth: Truth, references: np.ndarray, conditions: Conditions
) -> CommandSequence:
    """Let an arm follow long references (K, pieces T, n) [rad] and cut what happens into K pieces episodes."""
    follower, length = Follower(arm, references, conditions.period), conditions.steps
    at, speeds = references[:, 0], follower.speeds[:, 0]
    states = play(arm, [truth], references, at, conditions.period, 0.0, speeds, follower)[0]
    n, starts = references.shape[2], states[:, :-1:length]
    begins = starts.reshape(-1, 2 * n)
    return CommandSequence(follower.commands.reshape(len(begins), length, n), begins[:, :n], begins[:, n:])
