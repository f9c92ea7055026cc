"""Slow approach of two arms to a pose: both are read at every step, and stop before a predicted collision."""

from itertools import pairwise

import numpy as np

from nas_data.errors import PathBlocked
from nas_data.policies.rollouts.two_arm_planner import TwoArmPlanner
from nas_data.recorders.arm_motion import APPROACH, LEAD, SETTLE, ArmMotion, plan_slow_path
from nas_data.recorders.path_planner import PathPlanner

PLANS = 5  # attempts to plan a path and follow it
SEEKING = 10.0  # [s] allowed for planning a path
LOOKAHEAD = 0.1  # [s] lookahead of the collision check
STILL = 0.15  # [rad/s] below which an arm counts as standing still
PATIENCE = 1.0  # [s] to wait until the arms stand still


class Approach:
    """Brings an attacker and a defender to poses [rad], shape (2n,), the attacker's joints first.

    Gravity sag is compensated, so that the arms reach the pose itself.
    """

    def __init__(self, attacker: ArmMotion, defender: ArmMotion, seeking: TwoArmPlanner, touching: PathPlanner) -> None:
        """Take over two arms.

        Args:
            attacker: The first arm.
            defender: The second arm.
            seeking: Plans the paths.
            touching: Checks collisions between measured poses.
        """
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
            f"On their slow ways the arms came so near to each other {PLANS} times that they were stopped; move both "
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
            if np.abs(velocities).max() < STILL:
                break
        return here

    def _follow(self, corners: np.ndarray) -> bool:
        """Follow waypoints [rad], shape (k, 2n), and hold the last; return False at a predicted collision."""
        slow = [plan_slow_path(a, b, self._period) for a, b in pairwise(corners)]
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
