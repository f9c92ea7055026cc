"""Collision-free slow paths between poses: the arm touches neither itself nor the floor."""

from collections.abc import Iterator
from itertools import pairwise

import mujoco
import numpy as np

from nas_data.errors import PathBlocked
from nas_data.joint_units import compute_angle_scales
from nas_data.robots.base import Robot
from nas_data.simulators.contact import ContactDistances, count_contacts, find_contacts
from nas_data.simulators.integrals import compute_weight
from nas_data.simulators.limits import command_limits, find_rest_pose
from nas_data.simulators.mujoco import MujocoSimulator
from nas_data.simulators.poses import complete_poses

CHECK_STEP = 0.02  # [rad] between two collision checks along a path
CONTACT_TOLERANCE = 0.001  # [m] by which bodies in contact at the start may approach further: readings are whole ticks


class PathPlanner:
    """Plans collision-free paths in joint space; its collision checks use the robot's model.

    The start pose may be in contact, because a person may have put the arm there. Such contacts may only open, and no
    new contact may appear.

    Attributes:
        rest: Intermediate pose for paths whose straight line is blocked [rad; m], shape (n,).
        radians: Joint travel that counts as one radian, shape (n,); see `joint_units.compute_angle_scales`.
    """

    def __init__(self, robot: Robot) -> None:
        self._simulator = MujocoSimulator(robot, 1 / robot.rate, threads=1)
        self._scratch = mujoco.MjData(self._simulator.model)
        self.rest = find_rest_pose(robot, self._simulator.model)
        low, high = command_limits(self._simulator.model, robot.joints, robot.name)
        self.radians = compute_angle_scales(robot.joints, self.slides, high - low)

    @property
    def slides(self) -> tuple[str, ...]:
        """Names of the slide joints."""
        return self._simulator.slides

    def find(self, begin: np.ndarray, end: np.ndarray) -> np.ndarray:
        """Find a collision-free path: straight in joint space, or around an obstacle.

        Args:
            begin: Present pose [rad; m], shape (n,).
            end: Target pose [rad; m], shape (n,).

        Returns:
            Waypoints [rad; m], shape (k, n), joined by straight lines in joint space. The last one is the target.

        Raises:
            PathBlocked: every candidate path is blocked.
        """
        for corners in self.candidates(begin, end):
            if self.is_free(np.stack([begin, *corners])):
                return np.stack(corners)
        raise PathBlocked(
            f"On its slow motion to the next pose the arm would touch {self.obstacle(begin, end)}; move it upright by "
            "hand (the torque is off) and start again."
        )

    def candidates(self, begin: np.ndarray, end: np.ndarray) -> Iterator[list[np.ndarray]]:
        """Yield the waypoints of candidate paths: straight, through the rest pose, and with one joint moved alone."""
        yield [end]
        yield [self.rest, end]
        for first in self._rest_each_joint(begin):
            yield [first, self.rest, end]
            for last in self._rest_each_joint(end):
                yield [first, self.rest, last, end]
        for last in self._rest_each_joint(end):
            yield [self.rest, last, end]

    def is_free(self, corners: np.ndarray) -> bool:
        """Whether straight lines between waypoints [rad; m], shape (k, n), make no new contact."""
        if self.touches(corners[-1]):
            return False
        path = np.concatenate([self._interpolate(a, b) for a, b in pairwise(corners)])
        touching = count_contacts(self._simulator, path) > 0
        parted = int(np.argmin(touching))
        return not touching[parted:].any() and self._is_only_separating(path[:parted])

    def exists(self, begin: np.ndarray, end: np.ndarray) -> bool:
        """Whether a collision-free path joins two poses [rad; m], shape (n,)."""
        return any(self.is_free(np.stack([begin, *corners])) for corners in self.candidates(begin, end))

    def obstacle(self, begin: np.ndarray, end: np.ndarray) -> str:
        """Return the first new contact on the straight path, as the names of both bodies."""
        known = find_contacts(self._simulator, begin).keys()
        for pose in self._interpolate(begin, end):
            new = find_contacts(self._simulator, pose).keys() - known
            if new:
                return " with ".join(reversed(min(new)))
        return "what it already touches"

    def touches(self, pose: np.ndarray) -> bool:
        """Whether a pose [rad; m], shape (n,), is in contact."""
        return bool(find_contacts(self._simulator, pose, self._scratch))

    def enters_contact(self, begin: np.ndarray, end: np.ndarray) -> bool:
        """Whether a motion between poses [rad; m], shape (n,), makes a new contact or deepens one."""
        soon = find_contacts(self._simulator, end, self._scratch)
        now = find_contacts(self._simulator, begin, self._scratch) if soon else {}
        return any(distance < now.get(pair, np.inf) for pair, distance in soon.items())

    def leaves_contact(self, begin: np.ndarray, end: np.ndarray) -> bool:
        """Whether a motion between poses [rad; m], shape (n,), opens the contacts of the first and makes none.

        The smallest clearance must grow. No pair of bodies may come closer by more than 1 mm.
        """
        now = find_contacts(self._simulator, begin, self._scratch)
        soon = find_contacts(self._simulator, end, self._scratch) if now else {}
        parts = all(distance > now.get(pair, np.inf) - CONTACT_TOLERANCE for pair, distance in soon.items())
        return bool(now) and parts and min(soon.values(), default=np.inf) > min(now.values())

    def sag(self, pose: np.ndarray) -> np.ndarray:
        """Return the gravity sag in a pose [rad], shape (n,): pose minus the command that holds it.

        A servo without integral gain settles where its proportional torque balances gravity, so the sag is the torque
        of the weight divided by the gain.
        """
        model, data, layout = self._simulator.model, self._scratch, self._simulator.layout
        qpos = complete_poses(model, layout.qpos, layout.followers, pose[None])
        weight = compute_weight(model, data, qpos, layout.followers)[0]
        return np.asarray(-weight[layout.dof] / model.actuator_gainprm[layout.control, 0])

    def _rest_each_joint(self, pose: np.ndarray) -> list[np.ndarray]:
        """Return copies of a pose, each with another joint at rest."""
        return [np.where(np.arange(len(pose)) == joint, self.rest, pose) for joint in range(len(pose))]

    def _is_only_separating(self, path: np.ndarray) -> bool:
        """Return whether the contacts at the start of a path only open along it."""
        allowed: ContactDistances | None = None
        for pose in path:
            now = find_contacts(self._simulator, pose)
            if allowed is not None and any(now[pair] < allowed.get(pair, np.inf) - CONTACT_TOLERANCE for pair in now):
                return False
            allowed = now if allowed is None else {pair: allowed[pair] for pair in now}
        return True

    def _interpolate(self, begin: np.ndarray, end: np.ndarray) -> np.ndarray:
        """Return poses [rad; m] along a straight line in joint space, both ends included, shape (k, n)."""
        steps = max(1, int(np.ceil((np.abs(end - begin) / self.radians).max() / CHECK_STEP)))
        return np.asarray(begin + np.linspace(0, 1, steps + 1)[:, None] * (end - begin))
