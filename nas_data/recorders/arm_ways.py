"""Slow ways from pose to pose on which an arm touches neither itself nor the floor."""

from collections.abc import Iterator
from itertools import pairwise

import mujoco
import numpy as np

from nas_data.errors import WayBlocked
from nas_data.joint_units import radians_at
from nas_data.robots.base import Robot
from nas_data.simulators.contact import Touches, contact_counts, touches
from nas_data.simulators.limits import command_limits
from nas_data.simulators.mujoco import MujocoSimulator

LOOK = 0.02  # [rad] between two looks along a way
CLOSER = 0.001  # [m] by which what touches at the start may come closer before it parts: readings are whole ticks


class Ways:
    """The free ways of one arm, told by its model.

    Where the arm stands may touch something, for a hand put it there; what touches may part, and nothing new may touch.

    Attributes:
        rest: The pose over which a way leads where the straight one is not free [rad; m], shape (n,).
        radians: What stands for a radian at each joint, shape (n,); see `joint_units.radians_at`.
    """

    def __init__(self, robot: Robot) -> None:
        self._simulator = MujocoSimulator(robot, 1 / robot.rate, threads=1)
        self._room = mujoco.MjData(self._simulator.model)
        self.rest = np.array(robot.rest or np.zeros(len(robot.joints)))
        low, high = command_limits(self._simulator.model, robot.joints, robot.name)
        self.radians = radians_at(robot.joints, self.slides, high - low)

    @property
    def slides(self) -> tuple[str, ...]:
        """Names of the joints that are slides."""
        return self._simulator.slides

    def find(self, begin: np.ndarray, end: np.ndarray) -> np.ndarray:
        """Return the corners of a free way: the straight one, or one round what is in its way.

        Args:
            begin: Where the arm stands [rad], shape (n,).
            end: Where it shall go [rad], shape (n,).

        Returns:
            Poses [rad] to go to one after the other, straight in joint space, shape (k, n); the last is the end.

        Raises:
            WayBlocked: no way is free.
        """
        for corners in self.candidates(begin, end):
            if self.is_free(np.stack([begin, *corners])):
                return np.stack(corners)
        raise WayBlocked(
            f"On the slow way to its next pose the arm would touch {self.obstacle(begin, end)}; move it upright by "
            "hand (the torque is off) and start again."
        )

    def candidates(self, begin: np.ndarray, end: np.ndarray) -> Iterator[list[np.ndarray]]:
        """Yield the straight way, that over the rest pose, and those that move one joint first or last."""
        yield [end]
        yield [self.rest, end]
        for first in self._one_at_rest(begin):
            yield [first, self.rest, end]
            for last in self._one_at_rest(end):
                yield [first, self.rest, last, end]
        for last in self._one_at_rest(end):
            yield [self.rest, last, end]

    def is_free(self, corners: np.ndarray) -> bool:
        """Return whether nothing new touches along straight lines between poses [rad], shape (k, n)."""
        if self.touches(corners[-1]):
            return False
        path = np.concatenate([self._between(a, b) for a, b in pairwise(corners)])
        touching = contact_counts(self._simulator, path) > 0
        parted = int(np.argmin(touching))
        return not touching[parted:].any() and self._parts(path[:parted])

    def exists(self, begin: np.ndarray, end: np.ndarray) -> bool:
        """Return whether there is a free way between two poses [rad], shape (n,)."""
        return any(self.is_free(np.stack([begin, *corners])) for corners in self.candidates(begin, end))

    def obstacle(self, begin: np.ndarray, end: np.ndarray) -> str:
        """Name what is first in the straight way."""
        known = touches(self._simulator, begin).keys()
        for pose in self._between(begin, end):
            new = touches(self._simulator, pose).keys() - known
            if new:
                return " with ".join(reversed(min(new)))
        return "what it touches now even more"

    def touches(self, pose: np.ndarray) -> bool:
        """Return whether a pose [rad], shape (n,), touches something."""
        return bool(touches(self._simulator, pose, self._room))

    def leads_into_touch(self, begin: np.ndarray, end: np.ndarray) -> bool:
        """Return whether something touches in a pose [rad], shape (n,), that in another does not, or less."""
        soon = touches(self._simulator, end, self._room)
        now = touches(self._simulator, begin, self._room) if soon else {}
        return any(distance < now.get(pair, np.inf) for pair, distance in soon.items())

    def leads_out_of_touch(self, begin: np.ndarray, end: np.ndarray) -> bool:
        """Return whether a pose [rad], shape (n,), touches something, and another touches nothing else and less of it.

        Less is a larger clearance where it is smallest, while no pair of bodies comes closer by more than a millimetre.
        """
        now = touches(self._simulator, begin, self._room)
        soon = touches(self._simulator, end, self._room) if now else {}
        parts = all(distance > now.get(pair, np.inf) - CLOSER for pair, distance in soon.items())
        return bool(now) and parts and min(soon.values(), default=np.inf) > min(now.values())

    def sag(self, pose: np.ndarray) -> np.ndarray:
        """Return how far the arm hangs from a command that keeps it in a pose [rad], shape (n,): pose minus command.

        A servo without integral gain gives way until its spring carries the weight: gravity's torque over its gain.
        """
        model, data, layout = self._simulator.model, self._room, self._simulator.layout
        data.qpos[layout.qpos], data.qvel[:] = pose, 0.0
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        torques = np.empty(model.nv)
        mujoco.mj_rne(model, data, 0, torques)
        return np.asarray(-torques[layout.dof] / model.actuator_gainprm[layout.control, 0])

    def _one_at_rest(self, pose: np.ndarray) -> list[np.ndarray]:
        """Return the pose with each of its joints in turn at rest."""
        return [np.where(np.arange(len(pose)) == joint, self.rest, pose) for joint in range(len(pose))]

    def _parts(self, path: np.ndarray) -> bool:
        """Return whether what touches at the start of a path only comes apart on it."""
        allowed: Touches | None = None
        for pose in path:
            now = touches(self._simulator, pose)
            if allowed is not None and any(now[pair] < allowed.get(pair, np.inf) - CLOSER for pair in now):
                return False
            allowed = now if allowed is None else {pair: allowed[pair] for pair in now}
        return True

    def _between(self, begin: np.ndarray, end: np.ndarray) -> np.ndarray:
        """Return poses [rad; m] along a straight line, both ends included, shape (k, n)."""
        steps = max(1, int(np.ceil((np.abs(end - begin) / self.radians).max() / LOOK)))
        return np.asarray(begin + np.linspace(0, 1, steps + 1)[:, None] * (end - begin))
