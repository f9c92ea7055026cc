"""Striker: an arm of seven torque motors strikes a ball so that it rolls into a goal."""

from dataclasses import dataclass
from functools import partial

import numpy as np
from gymnasium import spaces

from nas_data.envs.base import Start, StepResult, Task
from nas_data.envs.edits.bigger_gap import widen_gap
from nas_data.envs.edits.pulled_joint import pull_joint
from nas_data.robots.base import ConsecutiveEdits
from nas_data.robots.striker import JOINTS, RATE
from nas_data.simulators.base import Stepper

TORQUE = 3.0  # [N·m] at action 1
TIP = "tip"  # site at the paddle's centre of mass
START_SPEED = 0.1  # [rad/s] joints start at zero with speeds within ± this, the authors' environment
BALL = np.array([0.5, -0.175])  # [m] initial x and y, likewise
GOAL = ((0.15, 0.7), (0.1, 1.0))  # [m] ranges of the goal's x and y, likewise
MIN_GOAL_DISTANCE = 0.17  # [m] least first distance of ball and goal, likewise
BALL_HEIGHT, GOAL_HEIGHT = -0.27, -0.323  # [m] the authors' distances are taken in space
TOUCHED = 0.1  # [m] from tip to ball at which it counts as struck, likewise
REACHED = 0.08  # [m] radius of the authors' goal disc

GOAL_COST, EFFORT_COST, REACH_COST = 3.0, 0.1, 0.5  # per m, per N²m² and per m, the authors' reward
SMALLEST_DISTANCE, IS_STRUCK, IMPACT_POINT = 2, 3, slice(4, 7)  # indices of the memory after the goal's x and y

BACKLASH = tuple(f"backlash:joint={joint},half_width=0.15" for joint in ("pan", "elbow_flex", "wrist_flex"))


@dataclass(frozen=True, kw_only=True)
class Striker(Task):
    """The reward is minus three times the smallest distance [m] of ball and goal so far, minus effort and reach costs.

    The reach cost is the distance of tip and ball before the ball is struck, and the distance from the point of impact
    afterwards. The observation holds seven angles [rad], seven velocities [rad/s], and the positions [m] of tip, ball
    and goal. The action holds torques.
    """

    def start(self, rng: np.random.Generator) -> Start:
        """Draw joint speeds and a goal [m]."""
        state = np.zeros(2 * len(JOINTS))
        state[len(JOINTS) :] = rng.uniform(-START_SPEED, START_SPEED, len(JOINTS))
        goal = BALL
        while np.hypot(*(goal - BALL)) <= MIN_GOAL_DISTANCE:
            goal = np.array([rng.uniform(*limits) for limits in GOAL])
        memory = np.array([*goal, np.inf, 0.0, 0.0, 0.0, 0.0])
        return Start(state=state, goal=memory, objects=np.array([BALL[1], BALL[0], 0.0, 0.0]))

    def command(self, actions: np.ndarray) -> np.ndarray:
        """Return torques [N·m], shape (B, 7)."""
        return actions * TORQUE

    def observe(self, stepper: Stepper, goals: np.ndarray) -> np.ndarray:
        """Return observations, shape (B, 23)."""
        parts = [
            stepper.states,
            stepper.site_positions(TIP),
            compute_ball_positions(stepper),
            compute_goal_positions(goals),
        ]
        observations = np.concatenate(parts, axis=1).astype(np.float32)
        return np.clip(observations, self.observation_space.low, self.observation_space.high)

    def follow(self, stepper: Stepper, goals: np.ndarray, elapsed: np.ndarray) -> np.ndarray:
        """Store the smallest distance of ball and goal, and where the ball was last struck."""
        goals, ball, tip = goals.copy(), compute_ball_positions(stepper), stepper.site_positions(TIP)
        goals[:, SMALLEST_DISTANCE] = np.minimum(
            goals[:, SMALLEST_DISTANCE], np.linalg.norm(ball - compute_goal_positions(goals), axis=1)
        )
        struck = np.linalg.norm(ball - tip, axis=1) < TOUCHED
        goals[struck, IS_STRUCK] = 1.0
        goals[struck, IMPACT_POINT] = tip[struck]
        return goals

    def judge(self, stepper: Stepper, goals: np.ndarray, actions: np.ndarray) -> StepResult:
        """Reward a ball close to the goal, a tip close to the ball before the strike, and small torques."""
        aim = np.where(goals[:, IS_STRUCK, None] > 0, goals[:, IMPACT_POINT], stepper.site_positions(TIP))
        away = np.linalg.norm(compute_ball_positions(stepper) - aim, axis=1)
        effort = np.square(self.command(actions)).sum(axis=1)
        return StepResult(
            reward=-GOAL_COST * goals[:, SMALLEST_DISTANCE] - EFFORT_COST * effort - REACH_COST * away,
            terminated=np.zeros(len(goals), dtype=bool),
            success=goals[:, SMALLEST_DISTANCE] < REACHED,
        )

    def hold(self, stepper: Stepper) -> np.ndarray:
        """Return zero torques: the arm has no gravity load."""
        return np.zeros((stepper.size, len(JOINTS)))


def compute_ball_positions(stepper: Stepper) -> np.ndarray:
    """Return the positions of the balls [m], shape (B, 3); the scene's slides are y, then x."""
    places = stepper.objects
    return np.stack([places[:, 1], places[:, 0], np.full(len(places), BALL_HEIGHT)], axis=1)


def compute_goal_positions(goals: np.ndarray) -> np.ndarray:
    """Return the positions of the goals [m], shape (B, 3)."""
    return np.concatenate([goals[:, :2], np.full((len(goals), 1), GOAL_HEIGHT)], axis=1)


# [rad], [rad/s], then [m] thrice: the joints' ranges, the speed that the motors reach with room to spare, and the table
OBSERVATION_BOUND = np.array([3.0] * 7 + [30.0] * 7 + [3.0] * 9, dtype=np.float32)

TASK = Striker(
    robot="striker",
    joints=JOINTS,
    period=1 / RATE,
    horizon=100,
    observation_space=spaces.Box(-OBSERVATION_BOUND, OBSERVATION_BOUND, dtype=np.float32),
    action_space=spaces.Box(-1.0, 1.0, shape=(len(JOINTS),), dtype=np.float32),
    dynamics={"source": (), "backlash": BACKLASH, "paper": (), "bigger-gap": BACKLASH},
    edits={
        "paper": ConsecutiveEdits(
            partial(pull_joint, joint="pan", width=2.0),
            partial(pull_joint, joint="wrist_flex", width=2.0),
        ),
        "bigger-gap": partial(widen_gap, joint="pan", object_body="ball"),
    },
)
