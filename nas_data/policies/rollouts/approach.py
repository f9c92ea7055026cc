"""Two arms on their slow ways: both are read at every step, and stop where their readings say that they would touch."""

from itertools import pairwise

import numpy as np

from nas_data.errors import PathBlocked
from nas_data.policies.rollouts.two_arm_planner import TwoArmPlanner
from nas_data.recorders.arm_motion import APPROACH, LEAD, SETTLE, ArmMotion, plan_slow_path
from nas_data.recorders.path_planner import PathPlanner

PLANS = 5  # times that a way is looked for from where the arms stand before they are given up
SEEKING = 10.0  # [s] that it may take
AHEAD = 0.1  # [s] for which it is looked ahead on the way
STILL = 0.15  # [rad/s] below which an arm counts as standing
PATIENCE = 1.0  # [s] to wait for that


class Approach:
    """The slow ways of an attacker and a defender, one at a time; poses are of the one then the other [rad], (2n,).

    The arms' sag is made up for: they get where they are sent, not to what hangs below it.
    """

    def __init__(self, attacker: ArmMotion, defender: ArmMotion, seeking: TwoArmPlanner, touching: PathPlanner) -> None:
        """Take arms over.

        Args:
            attacker: The one arm.
            defender: The other one.
            seeking: Finds the ways.
            touching: Tells what touches.
        """
        self._arms, self._clock, self._period = (attacker, defender), attacker.clock, attacker.period
        self._seeking, self._touching, self._due = seeking, touching, 0.0

    def __call__(self, pose: np.ndarray) -> None:
        """Bring both arms into a pose and hold them there for a moment.

        Raises:
            PathBlocked: there is no free way, or the arms leave those there are.
            ArmError: something is wrong with an arm.
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

    def held(self, pose: np.ndarray) -> np.ndarray:
        """Return the command that keeps the arms in a pose, shape (2n,)."""
        return pose - self._touching.sag(pose)

    def _stop(self) -> np.ndarray:
        """Hold both arms where they are until they stand; return where that is, shape (2n,)."""
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
        """Go from corner to corner, shape (k, 2n), and stay at the last; return whether nothing would have touched."""
        slow = [plan_slow_path(a, b, self._period) for a, b in pairwise(corners)]
        path = np.concatenate([*slow, np.repeat(corners[-1:], round(SETTLE / self._period), axis=0)])
        ahead, self._due = round(AHEAD / self._period), self._clock.now() + LEAD
        for number, pose in enumerate(path):
            here, _ = self._read()
            soon = path[min(number + ahead, len(path) - 1)]
            near = here + np.clip(soon - here, -AHEAD * APPROACH, AHEAD * APPROACH)
            if self._touching.enters_contact(here, near):
                return False
            self._send(pose)
        self._read()
        return True

    def _read(self) -> tuple[np.ndarray, np.ndarray]:
        """Return positions [rad] and velocities [rad/s] of both arms at the next moment, shape (2n,) each."""
        self._clock.wait_until(self._due)
        self._due += self._period
        readings = [arm.sense() for arm in self._arms]
        positions, velocities = zip(*((reading.positions, reading.velocities) for reading in readings), strict=True)
        return np.concatenate(positions), np.concatenate(velocities)

    def _send(self, pose: np.ndarray) -> None:
        """Command both arms to where they hang in a pose."""
        for arm, command in zip(self._arms, np.split(self.held(pose), 2), strict=True):
            arm.send(command)
