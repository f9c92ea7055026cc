"""ErgoShield: an ErgoJr with a sword touches the shield of another as often as it can in ten seconds."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from gymnasium import spaces

from nas_data.envs.base import Start, StepResult, Task
from nas_data.envs.edits.authors_ergojr import authors_arm, authors_source
from nas_data.envs.edits.bigger_gap import widen_gap
from nas_data.robots import ergo_shield as scene
from nas_data.robots.ergojr import JOINTS
from nas_data.simulators.base import Stepper

ANGLE = np.pi / 2  # [rad] command at action 1, and the unit of observed angles
NO_LOAD_SPEED = 11.9  # [rad/s] at 7.4 V, XL-320 e-manual (114 rpm); the unit of observed velocities
OBSERVED_ANGLE = 1.5  # bound of observed angles in units of ANGLE: play and overshoot go a little beyond 1

DEFENDER_RANGE = np.radians(
    [45.0, 15.0, 15.0, 22.5, 15.0, 15.0]
)  # [rad] the defender's poses lie within ± this, appendix B
DEFENDER_PERIOD = 250  # control steps after which the defender takes another pose, 2.5 s in the authors' environment
POSES = 32  # poses drawn for an episode, taken up again from the first after the last
SAMPLES = 31  # points along the sword, 5 mm apart, for the hit test

TOUCHING, HIT, HITS, POSE, TOUCHES = range(5)  # indices of the memory: flags, counts, and the index of the pose
KNOWN = TOUCHES + 1  # index of the first stored pose; the random numbers for missed touches are last

# Play in every joint of the attacker, the speed limit of the authors' recordings (100°/s), and the radio link's delay
BACKLASH = (
    *(f"backlash:joint={joint},half_width=0.05" for joint in JOINTS),
    *(f"speed_limit:joint={joint},speed=1.745" for joint in JOINTS),
    *(f"command_delay:joint={joint},delay=0.01" for joint in JOINTS),
)

# The authors' target was their arm. This is what their recordings show of it: servos that cruise at 95 to 125°/s, move
# first 70 to 115 ms after their command, and rest 0.8 to 1.3° from it.
ARM = (
    *(f"speed_limit:joint={joint},speed=1.92" for joint in JOINTS),
    *(f"command_delay:joint={joint},delay=0.07" for joint in JOINTS),
    *(f"deadband:joint={joint},half_width=0.018" for joint in JOINTS),
)


def detect_touches(stepper: Stepper) -> np.ndarray:
    """Return whether sword and shield touch, shape (B,), by geometry, so that all engines agree."""
    top, bottom, centre, front = (
        stepper.site_positions(site)
        for site in (scene.SWORD_TOP, scene.SWORD_BOTTOM, scene.SHIELD_CENTRE, scene.SHIELD_FRONT)
    )
    along = np.linspace(0.0, 1.0, SAMPLES)[:, None]
    offsets = bottom[:, None] + along * (top - bottom)[:, None] - centre[:, None]
    height = np.einsum("bsi,bi->bs", offsets, front - centre)  # above the disc's middle; the axis is a unit vector
    radius = np.sqrt(np.maximum(np.square(offsets).sum(axis=2) - height**2, 0.0))
    outside = np.maximum(radius - scene.SHIELD_RADIUS, 0.0)
    above = np.maximum(np.abs(height) - scene.SHIELD_HALF, 0.0)
    return np.asarray((np.hypot(outside, above) < scene.SWORD_RADIUS).any(axis=1))


@dataclass(frozen=True, kw_only=True)
class ErgoShield(Task):
    """The reward is 1 for each touch of sword and shield. Then both arms are reset, the defender to another pose.

    The observation holds six angles and six velocities of the attacker, then of the defender. The action holds absolute
    targets of the attacker. The defender moves to a new pose every 2.5 s. φ and ψ model the attacker only.

    Attributes:
        touched: Returns whether sword and shield touch, shape (B,): by geometry, or by a contact sensor on real arms.
        missed: Share of touches that are not detected; 10 to 15 % on the authors' robots.
    """

    touched: Callable[[Stepper], np.ndarray] = detect_touches
    missed: float = 0.0

    def start(self, rng: np.random.Generator) -> Start:
        """Start at zero; draw the defender's poses [rad], and start it in the first one."""
        poses = rng.uniform(-DEFENDER_RANGE, DEFENDER_RANGE, (POSES, len(JOINTS)))
        # initialised as touching: a first contact counts only after the sword was clear of the shield
        memory = np.concatenate([[1.0, 0.0, 0.0, 0.0, 0.0], poses.ravel(), rng.random(POSES)])
        return Start(state=np.zeros(2 * len(JOINTS)), goal=memory, objects=make_rest_states(poses[:1])[0])

    def command(self, actions: np.ndarray) -> np.ndarray:
        """Return target angles [rad] of the attacker, shape (B, 6)."""
        return actions * ANGLE

    def observe(self, stepper: Stepper, goals: np.ndarray) -> np.ndarray:
        """Return observations, shape (B, 24)."""
        scales = np.repeat([ANGLE, NO_LOAD_SPEED] * 2, len(JOINTS))
        observations = (np.concatenate([stepper.states, stepper.objects], axis=1) / scales).astype(np.float32)
        return np.clip(observations, self.observation_space.low, self.observation_space.high)

    def follow(self, stepper: Stepper, goals: np.ndarray, elapsed: np.ndarray) -> np.ndarray:
        """Count each touch once, reset the arms after it, and give the defender its next pose when it is due."""
        goals = goals.copy()
        touching = self.touched(stepper)
        new = touching & (goals[:, TOUCHING] == 0)
        goals[:, TOUCHES] += new
        hit = new & (select_random_numbers(goals) >= self.missed)
        goals[:, TOUCHING], goals[:, HIT] = touching, hit
        goals[:, HITS] += hit
        due = ~hit & (elapsed % DEFENDER_PERIOD == 0)
        goals[hit | due, POSE] += 1
        parted, moved = np.flatnonzero(hit), np.flatnonzero(due)
        if len(parted):
            there = make_rest_states(select_defender_poses(goals[parted]))
            stepper.reset(np.concatenate([np.zeros_like(there), there], axis=1), parted)
        if len(moved):
            stepper.command_objects(select_defender_poses(goals[moved]), moved)
        return goals

    def judge(self, stepper: Stepper, goals: np.ndarray, actions: np.ndarray) -> StepResult:
        """Reward a hit in this step; an episode with a hit is a success."""
        over = np.zeros(len(goals), dtype=bool)
        return StepResult(reward=goals[:, HIT].copy(), terminated=over, success=goals[:, HITS] > 0)

    def hold(self, stepper: Stepper) -> np.ndarray:
        """Return the present angles as actions."""
        return stepper.states[:, : len(JOINTS)] / ANGLE


def select_defender_poses(goals: np.ndarray) -> np.ndarray:
    """Return the defender's present poses [rad], shape (B, 6)."""
    poses = goals[:, KNOWN:-POSES].reshape(len(goals), POSES, len(JOINTS))
    return np.asarray(poses[np.arange(len(goals)), goals[:, POSE].astype(int) % POSES])


def select_random_numbers(goals: np.ndarray) -> np.ndarray:
    """Return the random number in 0 … 1 that decides whether the present touch is missed, shape (B,)."""
    return np.asarray(goals[np.arange(len(goals)), goals[:, TOUCHES].astype(int) % POSES - POSES])


def make_rest_states(poses: np.ndarray) -> np.ndarray:
    """Return the states (B, 12) of arms at rest in poses [rad] (B, 6)."""
    return np.concatenate([poses, np.zeros_like(poses)], axis=1)


OBSERVATION_BOUND = np.repeat(np.array([OBSERVED_ANGLE, 1.0] * 2, dtype=np.float32), len(JOINTS))

TASK = ErgoShield(
    robot="ergo_shield",
    joints=JOINTS,
    period=0.01,
    horizon=1000,
    observation_space=spaces.Box(-OBSERVATION_BOUND, OBSERVATION_BOUND, dtype=np.float32),
    action_space=spaces.Box(-1.0, 1.0, shape=(len(JOINTS),), dtype=np.float32),
    dynamics={"source": (), "backlash": BACKLASH, "paper": ARM, "paper-source": (), "bigger-gap": BACKLASH},
    edits={
        "paper": authors_arm,
        "paper-source": authors_source,  # the authors' gap lies between this and their arm
        "bigger-gap": partial(widen_gap, joint="m1"),
    },
)
