"""Pusher: a planar arm of three torque motors pushes a puck to a goal on the table."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from gymnasium import spaces

from nas_data.envs.base import Start, StepResult, Task
from nas_data.envs.edits.bigger_gap import widen_gap
from nas_data.envs.edits.pulled_joint import pull_joint
from nas_data.robots.pusher import JOINTS, RATE
from nas_data.simulators.base import Stepper

TORQUE = 3.0  # [N·m] at action 1
GRIPPER = "gripper"  # site at the fork's centre of mass
START_ANGLE = 0.1  # [rad] joints start within ± this, at rest
PUCK = ((0.3, 1.2), (-1.0, -0.4))  # [m] ranges of its first x and y, the authors' environment
GOAL = ((0.8, 1.2), (-1.2, -0.8))  # [m] of the goal's x and y, likewise
MIN_GOAL_DISTANCE = 0.45  # [m] least first distance of puck and goal, likewise
PUCK_HEIGHT, GOAL_HEIGHT = -0.1, -0.145  # [m] the authors' distances are taken in space
REACHED = 0.17  # [m] radius of the authors' goal disc

EFFORT_COST, REACH_COST = 0.1, 0.5  # per N²m² and per m, the authors' reward

# A worn, dry gearbox at the shoulder: free play, and Coulomb friction on the motor's side of it. Free play alone, in
# any joint, costs a policy of the source next to nothing (0 to 3 of a return of −57 at ±0.2 rad): the links are heavy,
# the motors slow. With the friction it brings 2 % of the pucks to their goals, an expert 38 % (medians of five seeds).
BACKLASH = ("backlash:joint=j1,half_width=0.15", "coulomb_friction:joint=j1,torque=1.0")


@dataclass(frozen=True, kw_only=True)
class Pusher(Task):
    """The reward is minus the puck's distance [m] to the goal, minus costs of effort and of distance from the puck.

    The observation holds three angles [rad], three velocities [rad/s], and x and y [m] of gripper, puck and goal. The
    action holds torques. The authors reward the state before a step; here it is the state after it, which shifts a
    return of −70 by about 1.
    """

    def start(self, rng: np.random.Generator) -> Start:
        """Draw joint angles, and a puck away from its goal [m]."""
        state = np.zeros(2 * len(JOINTS))
        state[: len(JOINTS)] = rng.uniform(-START_ANGLE, START_ANGLE, len(JOINTS))
        puck, goal = draw_place(rng, PUCK), draw_place(rng, GOAL)
        while np.hypot(*(puck - goal)) <= MIN_GOAL_DISTANCE:
            puck, goal = draw_place(rng, PUCK), draw_place(rng, GOAL)
        return Start(state=state, goal=goal, objects=np.array([puck[1], puck[0], 0.0, 0.0]))

    def command(self, actions: np.ndarray) -> np.ndarray:
        """Return torques [N·m], shape (B, 3)."""
        return actions * TORQUE

    def observe(self, stepper: Stepper, goals: np.ndarray) -> np.ndarray:
        """Return observations, shape (B, 12)."""
        parts = [stepper.states, stepper.site_positions(GRIPPER)[:, :2], compute_puck_positions(stepper)[:, :2], goals]
        observations = np.concatenate(parts, axis=1).astype(np.float32)
        return np.clip(observations, self.observation_space.low, self.observation_space.high)

    def judge(self, stepper: Stepper, goals: np.ndarray, actions: np.ndarray) -> StepResult:
        """Reward a puck close to the goal, a gripper close to the puck, and small torques."""
        puck = compute_puck_positions(stepper)
        missing = np.linalg.norm(puck - with_height(goals, GOAL_HEIGHT), axis=1)
        away = np.linalg.norm(puck - stepper.site_positions(GRIPPER), axis=1)
        effort = np.square(self.command(actions)).sum(axis=1)
        return StepResult(
            reward=-missing - EFFORT_COST * effort - REACH_COST * away,
            terminated=np.zeros(len(goals), dtype=bool),
            success=np.linalg.norm(puck[:, :2] - goals, axis=1) < REACHED,
        )

    def hold(self, stepper: Stepper) -> np.ndarray:
        """Return zero torques: the arm has no gravity load."""
        return np.zeros((stepper.size, len(JOINTS)))


def draw_place(rng: np.random.Generator, limits: Sequence[tuple[float, float]]) -> np.ndarray:
    """Draw x and y [m] within their limits, shape (2,)."""
    return np.array([rng.uniform(*limit) for limit in limits])


def compute_puck_positions(stepper: Stepper) -> np.ndarray:
    """Return the positions of the pucks [m], shape (B, 3); the scene's slides are y, then x."""
    return with_height(stepper.objects[:, 1::-1], PUCK_HEIGHT)


def with_height(places: np.ndarray, height: float) -> np.ndarray:
    """Return positions [m], shape (B, 3), for x and y, shape (B, 2), and a height."""
    return np.concatenate([places, np.full((len(places), 1), height)], axis=1)


# [rad], [rad/s], then [m] thrice: the joints' ranges, the speed that the motors reach with room to spare, and the table
OBSERVATION_BOUND = np.array([3.0] * 3 + [10.0] * 3 + [3.0] * 6, dtype=np.float32)

TASK = Pusher(
    robot="pusher",
    joints=JOINTS,
    period=1 / RATE,
    horizon=100,
    observation_space=spaces.Box(-OBSERVATION_BOUND, OBSERVATION_BOUND, dtype=np.float32),
    action_space=spaces.Box(-1.0, 1.0, shape=(len(JOINTS),), dtype=np.float32),
    dynamics={"source": (), "backlash": BACKLASH, "paper": (), "bigger-gap": BACKLASH},
    edits={
        "paper": partial(pull_joint, joint="j2", width=20.0),
        "bigger-gap": partial(widen_gap, joint="j1", object_body="puck"),
    },
)
