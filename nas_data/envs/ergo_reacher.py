"""ErgoReacher: four joints of an ErgoJr bring the tip to a point in the plane in front of it."""

from dataclasses import dataclass
from functools import partial

import numpy as np
from gymnasium import spaces

from nas_data.envs.base import Start, StepResult, Task
from nas_data.envs.edits.authors_ergojr import authors_source, authors_target
from nas_data.envs.edits.bigger_gap import widen_gap
from nas_data.simulators.base import Stepper

JOINTS = ("m1", "m2", "m3", "m4", "m5", "m6")
ACTIVE = np.array([1, 2, 4, 5])  # m2, m3, m5, m6; m1 and m4 are commanded to 0, which keeps the arm in the plane x = 0

ANGLE = np.pi / 2  # [rad] command at action 1, and the unit of observed angles
NO_LOAD_SPEED = 11.9  # [rad/s] at 7.4 V, XL-320 e-manual (114 rpm); the unit of observed velocities
START_ANGLE = np.radians(18.0)  # [rad] the active joints start within ± this, at rest
TIP = "tip"  # site at the end of the pen holder

# Goals as in the authors' environment: the part of a ring about a point near the shoulder that lies ahead and above.
CENTRE = np.array([0.0, 0.0369, 0.0437])  # [m]
RING = (0.1, 0.2022)  # [m] smallest and largest distance of a goal from the centre
MAX_Y = 0.2022  # [m] largest y offset
MAX_Z = 0.2610  # [m] largest z offset, before the limit by the ring
REACHED = 0.016  # [m] distance at which the goal counts as reached

OBSERVED_ANGLE = 1.5  # bound of observed angles in units of ANGLE: play and overshoot go a little beyond 1

# True play in two joints, measured behind it, and servos that approach their goals at a bounded rate: enough for a
# policy of the plain source to lose most of what an expert gains, little enough for the expert to learn in minutes.
BACKLASH = (
    "backlash:joint=m3,half_width=0.12",
    "backlash:joint=m6,half_width=0.12",
    *(f"speed_limit:joint={joint},speed=5.0" for joint in JOINTS),
)


@dataclass(frozen=True, kw_only=True)
class ErgoReacher(Task):
    """The reward is minus the distance [m] of tip and goal. Within 16 mm it is increased by 1, and the episode ends.

    The observation holds four angles, four velocities, and the goal's y and z. The action holds absolute targets.
    """

    def start(self, rng: np.random.Generator) -> Start:
        """Draw joint angles and a goal [m]."""
        state = np.zeros(2 * len(JOINTS))
        state[ACTIVE] = rng.uniform(-START_ANGLE, START_ANGLE, len(ACTIVE))
        offset = np.zeros(3)
        while not RING[0] <= np.hypot(offset[1], offset[2]) <= RING[1]:
            offset[1:] = rng.uniform(0.0, (MAX_Y, MAX_Z))
        return Start(state=state, goal=CENTRE + offset)

    def command(self, actions: np.ndarray) -> np.ndarray:
        """Return target angles [rad] of all six joints, shape (B, 6)."""
        commands = np.zeros((len(actions), len(JOINTS)))
        commands[:, ACTIVE] = actions * ANGLE
        return commands

    def observe(self, stepper: Stepper, goals: np.ndarray) -> np.ndarray:
        """Return observations, shape (B, 10)."""
        states = stepper.states
        offset = goals - CENTRE
        observations = np.empty((len(states), 10), dtype=np.float32)
        observations[:, :4] = states[:, ACTIVE] / ANGLE
        observations[:, 4:8] = states[:, len(JOINTS) + ACTIVE] / NO_LOAD_SPEED
        observations[:, 8] = offset[:, 1] / MAX_Y
        observations[:, 9] = 2.0 * offset[:, 2] / MAX_Z - 1.0
        return np.clip(observations, self.observation_space.low, self.observation_space.high)

    def judge(self, stepper: Stepper, goals: np.ndarray, actions: np.ndarray) -> StepResult:
        """Reward a small distance between tip and goal."""
        distance = np.linalg.norm(stepper.site_positions(TIP) - goals, axis=1)
        reached = distance < REACHED
        return StepResult(reward=reached - distance, terminated=reached, success=reached)

    def hold(self, stepper: Stepper) -> np.ndarray:
        """Return the present angles as actions."""
        return stepper.states[:, ACTIVE] / ANGLE


OBSERVATION_BOUND = np.array([OBSERVED_ANGLE] * 4 + [1.0] * 6, dtype=np.float32)

TASK = ErgoReacher(
    robot="ergojr_penholder",
    joints=JOINTS,
    period=0.01,
    horizon=100,
    observation_space=spaces.Box(-OBSERVATION_BOUND, OBSERVATION_BOUND, dtype=np.float32),
    action_space=spaces.Box(-1.0, 1.0, shape=(len(ACTIVE),), dtype=np.float32),
    dynamics={"source": (), "backlash": BACKLASH, "paper": (), "paper-source": (), "bigger-gap": BACKLASH},
    edits={
        "paper": authors_target,
        "paper-source": authors_source,  # the authors' gap lies between these two
        "bigger-gap": partial(widen_gap, joint="m1"),
    },
)
