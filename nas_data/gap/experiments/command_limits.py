"""Range of commands of an experiment, with rest pose, limits and ramps."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from nas_data.dataset.features import EFFORT
from nas_data.excitations.base import Excitation
from nas_data.gap.episode_batch import EpisodeBatch
from nas_data.gap.nominal import Nominal
from nas_data.simulators.limits import command_limits, command_radians, find_excitable_limits

SPEED = 0.5  # [rad/s or N·m/s] of a slow approach
FASTER = 2.0  # times the recorded speed: largest speed of joints that are given torques
SHORTEST = 1.0  # [s] smallest duration of a slow approach, in which the arm settles in its rest pose


@dataclass(frozen=True)
class CommandRange:
    """Range of commands.

    Attributes:
        period: Control period [s].
        pose: Initial pose [rad; m], shape (n,).
        home: Command of the initial pose [rad or N·m], shape (n,).
        low: Lowest commands, shape (n,).
        high: Highest commands, shape (n,).
        radians: Equivalent of a radian in each joint's commands, shape (n,); see `joint_units.compute_angle_scales`.
        fastest: Largest speed of each joint [rad/s; m/s], shape (n,).
    """

    period: float
    pose: np.ndarray
    home: np.ndarray
    low: np.ndarray
    high: np.ndarray
    radians: np.ndarray | float = 1.0
    fastest: np.ndarray | float = np.inf

    @classmethod
    def of(cls, nominal: Nominal, evidence: EpisodeBatch) -> "CommandRange":
        """Read rest pose and limits from a model, and speeds from a recording.

        Nothing in a model limits the speed of a joint that is given torques. It may move twice as fast as recorded.

        Raises:
            OptionError: the model takes torques without limits.
        """
        simulator, joints = nominal.simulator(), nominal.joints
        low, high = command_limits(simulator.model, joints, str(nominal.robot.mjcf))
        low, high = find_excitable_limits(low, high, joints, simulator.kinds, simulator.slides)
        pose = find_rest_pose(nominal)
        home = np.where(simulator.layout.inputs.positional, pose, 0.0)
        recorded = np.abs(np.diff(evidence.measured, axis=1) * evidence.mask[:, 1:, None]).max((0, 1)) / nominal.period
        fastest = np.where([kind == EFFORT for kind in simulator.kinds], FASTER * recorded, np.inf)
        radians = command_radians(simulator, low, high)
        return cls(nominal.period, pose, np.clip(home, low, high), low, high, radians, fastest)

    @property
    def middle(self) -> np.ndarray:
        """Middle of each range, shape (n,)."""
        return np.asarray((self.low + self.high) / 2)

    @property
    def span(self) -> np.ndarray:
        """Half of each range, shape (n,)."""
        return np.asarray((self.high - self.low) / 2)

    def shrink(self, share: float) -> "CommandRange":
        """Return a range reduced to a share of the way from home to each limit."""
        low, high = (self.home + share * (limit - self.home) for limit in (self.low, self.high))
        return replace(self, low=low, high=high)

    def steps(self, seconds: float) -> int:
        """Return the number of control steps of a duration, at least one."""
        return max(1, round(seconds / self.period))

    def draw_excitation(
        self, excitation: Excitation, seconds: float, moving: np.ndarray, rng: np.random.Generator
    ) -> np.ndarray:
        """Draw commands of an excitation for the joints `moving` (n,), the others at home; shape (T, n)."""
        drawn = excitation.commands(rng, 1, self.steps(seconds), self.period, self.low, self.high, self.radians)[0]
        return np.where(moving, drawn, self.home)

    def ramp(self, begin: np.ndarray, end: np.ndarray, speed: float, shortest: float = 0.0) -> np.ndarray:
        """Return commands at constant speed [rad/s] between two poses, without the first; shape (T, n)."""
        seconds = max(shortest, float((np.abs(end - begin) / self.radians).max()) / speed)
        parts = np.arange(1, math.ceil(seconds / self.period) + 1) / max(1, math.ceil(seconds / self.period))
        return np.asarray(begin + parts[:, None] * (end - begin))

    def prepend_approach(self, body: np.ndarray) -> np.ndarray:
        """Return commands (T, n) preceded by a slow approach from home."""
        whole = np.concatenate([self.home[None], self.ramp(self.home, body[0], SPEED, SHORTEST), body])
        return np.clip(whole, self.low, self.high)  # removes rounding errors


def find_rest_pose(nominal: Nominal) -> np.ndarray:
    """Return the robot's rest pose, else zero [rad; m], shape (n,)."""
    known = dict(zip(nominal.robot.joints, nominal.robot.rest, strict=False))
    return np.array([known.get(joint, 0.0) for joint in nominal.joints])


def mask_joints(joints: Sequence[str], moved: Sequence[str]) -> np.ndarray:
    """Return a mask of the joints in `moved`, shape (n,)."""
    return np.array([joint in moved for joint in joints])
