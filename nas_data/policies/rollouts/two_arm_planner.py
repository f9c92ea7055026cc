"""Two arms: collision checks, collision-free slow paths on which one moves at a time, and the approach to a pose."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise

import mujoco
import numpy as np

from nas_data.errors import PathBlocked
from nas_data.recorders.arm_motion import APPROACH, LEAD, SEEKING, SETTLE, ArmMotion, plan_slow_path
from nas_data.recorders.path_planner import PathPlanner
from nas_data.robots.base import ConsecutiveEdits
from nas_data.robots.ergo_shield import DEFENDER, DEFENDERS_JOINTS
from nas_data.robots.ergo_shield import ROBOT as DUEL
from nas_data.robots.ergojr import JOINTS

HULLS = ("case", "hull2", "hull4", "hull5")  # collision hulls from the base to the link before the tip
# The hull of the tip is that of an arm with its plain tip, and reaches beyond sword and shield. Between two arms, the
# servo that it covers replaces it, so that a sword may touch a shield.
SERVO = "motor6"
OWN, OTHER, SWORD, SHIELD = 1, 2, 4, 8  # collision bits; the model's hulls and floor have the first


class TwoArmPlanner:
    """Plans paths of an attacker and a defender; poses [rad], shape (2n,), have the attacker's joints first."""

    def __init__(self, alone: PathPlanner, together: Sequence[PathPlanner]) -> None:
        """Set the planner of one arm, and those of both, largest clearance first; the first with a path counts."""
        self._alone, self._together = alone, together
        self._attacker = np.arange(2 * len(alone.rest)) < len(alone.rest)

    def find(self, begin: np.ndarray, end: np.ndarray) -> np.ndarray:
        """Find a collision-free path between two poses [rad], shape (2n,).

        Returns:
            Waypoints [rad], shape (k, 2n). One arm moves between two of them, straight in joint space. The last one
            is the target.

        Raises:
            PathBlocked: no path is free.
        """
        for planner in self._together:
            for stops in self._generate_orders(begin, end):
                corners = self._plan_stops(planner, np.stack([begin, *stops]))
                if corners is not None:
                    return corners
        raise PathBlocked(
            f"On their slow motions to the next poses the arms would touch: {self._together[-1].obstacle(begin, end)}; "
            "move both upright by hand (the torque is off) and start again."
        )

    def _generate_orders(self, begin: np.ndarray, end: np.ndarray) -> Iterator[list[np.ndarray]]:
        """Yield the poses after each move of candidate orders: directly, one arm first to rest, both first to rest."""
        rest = np.concatenate([self._alone.rest] * 2)
        orders = (self._attacker, ~self._attacker)
        for first in orders:
            yield [np.where(first, end, begin), end]
        for first in orders:
            aside = np.where(first, rest, begin)
            yield [aside, np.where(first, aside, end), end]
        for first in orders:
            yield [np.where(first, rest, begin), rest, np.where(first, end, rest), end]

    def _plan_stops(self, planner: PathPlanner, stops: np.ndarray) -> np.ndarray | None:
        """Return the waypoints of a free path through stops, shape (k, 2n); None if there is none."""
        legs = list[np.ndarray]()
        for a, b in reversed(list(pairwise(stops))):  # backwards, as a target pose in contact is rejected soonest
            leg = self._plan_move(planner, a, b)
            if leg is None:
                return None
            legs.insert(0, leg)
        return np.concatenate(legs)

    def _plan_move(self, planner: PathPlanner, begin: np.ndarray, end: np.ndarray) -> np.ndarray | None:
        """Return the waypoints of a free path on which a single arm moves, shape (k, 2n); None if there is none."""
        moves = self._attacker if (begin != end)[self._attacker].any() else ~self._attacker
        if planner.touches(end):
            return None
        for corners in self._alone.candidates(begin[moves], end[moves]):
            path = np.stack([begin, *(_replace_joints(begin, moves, corner) for corner in corners)])
            if planner.is_free(path) and self._alone.is_free(path[:, moves]):
                return path[1:]
        return None


def _replace_joints(pose: np.ndarray, moves: np.ndarray, half: np.ndarray) -> np.ndarray:
    """Return a pose, shape (2n,), with the joints of the mask `moves`, shape (2n,), set to `half`, shape (n,)."""
    whole = pose.copy()
    whole[moves] = half
    return whole


def set_contact_masks(spec: mujoco.MjSpec) -> None:
    """Enable contacts of the attacker with itself, the floor and the defender's body, and no others."""
    for name in (*HULLS, SERVO):
        spec.geom(name).conaffinity |= OTHER
        spec.geom(DEFENDER + name).contype, spec.geom(DEFENDER + name).conaffinity = OTHER, 0
    spec.geom(DEFENDER + "hull6").contype = spec.geom(DEFENDER + "hull6").conaffinity = 0


def add_edges(spec: mujoco.MjSpec) -> None:
    """Enable contacts of sword with defender and of shield with attacker, but not of the tips with each other."""
    set_contact_masks(spec)
    spec.geom("sword").contype, spec.geom(DEFENDER + "shield").contype = SWORD, SHIELD
    for name in HULLS:
        spec.geom(DEFENDER + name).conaffinity |= SWORD
        spec.geom(name).conaffinity |= SHIELD


def keep_clear(spec: mujoco.MjSpec, clearance: float) -> None:
    """Count a distance between the arms below the clearance [m] as a contact."""
    for geom in spec.geoms:
        if geom.name.startswith(DEFENDER):
            geom.margin = clearance


def make_two_arm_planner(edges: bool = False, clearance: float = 0.0) -> PathPlanner:
    """Return the collision checks of both arms, in poses [rad], shape (12,), with the attacker's joints first.

    Args:
        edges: Whether sword and shield collide with the other arm's body. They do not in the environment's model, so
            policies that were trained there pass through.
        clearance: Distance between the arms below which they count as in contact [m].
    """
    touching = ConsecutiveEdits(add_edges if edges else set_contact_masks, partial(keep_clear, clearance=clearance))
    edit = ConsecutiveEdits(DUEL.edit, touching)
    return PathPlanner(replace(DUEL, name="two_ergojr", joints=(*JOINTS, *DEFENDERS_JOINTS), edit=edit))


PLANS = 5  # attempts to plan a path and follow it
LOOKAHEAD = 0.1  # [s] lookahead of the collision check
RESTING_SPEED = 0.15  # [rad/s] below which an arm counts as standing still
PATIENCE = 1.0  # [s] to wait until the arms stand still


class Approach:
    """Brings an attacker and a defender to poses [rad], shape (2n,), the attacker's joints first.

    Gravity sag is compensated, so that the arms reach the pose itself.
    """

    def __init__(self, attacker: ArmMotion, defender: ArmMotion, seeking: TwoArmPlanner, touching: PathPlanner) -> None:
        """Take over two arms."""
        self._arms, self._clock, self._period = (attacker, defender), attacker.clock, attacker.period
        self._seeking, self._touching, self._due = seeking, touching, 0.0

    def __call__(self, pose: np.ndarray) -> None:
        """Bring both arms to a pose [rad], shape (2n,), and hold it for half a second.

        Raises:
            PathBlocked: no path is free, or the arms left the planned path too often.
            ArmError: an arm failed.
        """
        for _ in range(PLANS):
            here = self._stop()
            self._arms[0].extend_deadline(SEEKING)
            if self._follow(np.stack([here, *self._seeking.find(here, pose)])):
                return
        raise PathBlocked(
            f"The arms were stopped {PLANS} times because they came too close on their slow motions; move both "
            "upright by hand (the torque is off) and start again."
        )

    def compensate_sag(self, pose: np.ndarray) -> np.ndarray:
        """Return the command that holds a pose against gravity [rad], shape (2n,)."""
        return pose - self._touching.sag(pose)

    def _stop(self) -> np.ndarray:
        """Hold both arms until they stand still; return the measured pose [rad], shape (2n,)."""
        self._due = self._clock.now() + LEAD
        here, velocities = self._read()
        stay = here
        for _ in range(round(PATIENCE / self._period)):
            self._send(stay)
            here, velocities = self._read()
            if np.abs(velocities).max() < RESTING_SPEED:
                break
        return here

    def _follow(self, corners: np.ndarray) -> bool:
        """Follow waypoints [rad], shape (k, 2n), and hold the last; return False at a predicted collision."""
        step = self._period * min(arm.slow_speed for arm in self._arms)
        slow = [plan_slow_path(a, b, step) for a, b in pairwise(corners)]
        path = np.concatenate([*slow, np.repeat(corners[-1:], round(SETTLE / self._period), axis=0)])
        ahead, self._due = round(LOOKAHEAD / self._period), self._clock.now() + LEAD
        for number, pose in enumerate(path):
            here, _ = self._read()
            soon = path[min(number + ahead, len(path) - 1)]
            near = here + np.clip(soon - here, -LOOKAHEAD * APPROACH, LOOKAHEAD * APPROACH)
            if self._touching.enters_contact(here, near):
                return False
            self._send(pose)
        self._read()
        return True

    def _read(self) -> tuple[np.ndarray, np.ndarray]:
        """Read both arms at the next control period: positions [rad] and velocities [rad/s], shape (2n,) each."""
        self._clock.wait_until(self._due)
        self._due += self._period
        readings = [arm.sense() for arm in self._arms]
        positions, velocities = zip(*((reading.positions, reading.velocities) for reading in readings), strict=True)
        return np.concatenate(positions), np.concatenate(velocities)

    def _send(self, pose: np.ndarray) -> None:
        """Command both arms to a pose [rad], shape (2n,), with sag compensation."""
        for arm, command in zip(self._arms, np.split(self.compensate_sag(pose), 2), strict=True):
            arm.send(command)
