"""A whole simulated arm: its servos on one line, in one body."""

from collections.abc import Sequence
from dataclasses import replace

import mujoco
import numpy as np

from nas_data.effects.base import Effect
from nas_data.robots.base import find_robot
from nas_data.simulators.engines import load_simulator
from nas_data.virtual_bus.body import STEP, Body
from nas_data.virtual_bus.chain import Chain
from nas_data.virtual_bus.servo import Servo
from nas_data.xl320.ergojr import ergojr_joints

LYING = np.array([0.2, -1.31, 0.72, -0.15, 0.94, 0.28])  # [rad] about Poppy's rest pose, as a hand would leave it
TURN = np.radians(150)  # [rad] from the middle to either end, XL-320 e-manual


class VirtualArm:
    """An ErgoJr as it comes out of the box: torque off, factory settings, identities 1 to 6.

    Attributes:
        servos: In the order of the joints.
        chain: The same on one line.
        body: What they move.
    """

    def __init__(self, effects: Sequence[Effect] = (), offsets: Sequence[int] = ()) -> None:
        """Assemble the arm.

        Args:
            effects: What the simulated arm has and its model lacks.
            offsets: Ticks by which the horns were mounted off the middle, one a servo; none where empty.
        """
        joints = ergojr_joints(tuple(-offset for offset in offsets))
        self.servos = [Servo(identity) for identity in joints.ids]
        self.chain = Chain(self.servos)
        robot = replace(find_robot("ergojr"), edit=_free)
        simulator = load_simulator(robot, STEP, effects=effects, threads=1)
        self.body = Body(simulator, robot, self.servos, joints)
        self.body.place(np.concatenate([LYING, np.zeros(len(LYING))]))


def _free(spec: mujoco.MjSpec) -> None:
    """Let the joints turn as far as a servo can: what keeps them within the arm's limits is software."""
    for joint in spec.joints:
        joint.range = np.array([-TURN, TURN])
