"""A simulated arm: servos on one bus, in one simulated body."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import mujoco
import numpy as np

from nas_data.effects.base import Effect
from nas_data.hardware.virtual_bus.body import Encoders, SimulatedBody
from nas_data.hardware.virtual_bus.chain import ServoChain
from nas_data.hardware.virtual_bus.kinds.base import find_kind
from nas_data.hardware.virtual_bus.servo import VirtualServo
from nas_data.hardware.xl320.control_table import TICK
from nas_data.hardware.xl320.joints import make_ergojr_joints
from nas_data.robots.base import Robot, find_robot
from nas_data.simulators.engines import load_simulator

LYING = np.array([0.2, -1.31, 0.72, -0.15, 0.94, 0.28])  # [rad] initial pose near Poppy's rest pose, as left by hand
TURN = np.radians(150)  # [rad] from the middle to either end, XL-320 e-manual
STEP = 0.002  # [s] least simulation step of an arm


@dataclass(frozen=True, kw_only=True)
class MountedServo:
    """A mounted and calibrated servo."""

    joint: str  # name of its joint
    kind: str  # its series, a file of `kinds/`
    id: int
    zero: float  # encoder count at the joint's zero
    sign: int  # 1 if the joint turns with the servo, −1 otherwise
    registers: dict[str, int]  # register values that differ from the factory settings, by name

    def servo(self) -> VirtualServo:
        """Create the servo with these registers."""
        servo = VirtualServo(self.id, kind=find_kind(self.kind))
        for name, value in self.registers.items():
            servo.put(name, value)
        servo.kind.power_on(servo)
        return servo


class VirtualArm:
    """An arm of servos whose torque is off."""

    def __init__(
        self,
        effects: Sequence[Effect],
        servos: Sequence[VirtualServo],
        robot: Robot,
        encoders: Encoders,
        lying: np.ndarray,
    ) -> None:
        """Assemble an arm.

        Args:
            effects: Effects of the simulated arm that its model lacks.
            servos: One servo per joint.
            robot: Model of the arm.
            encoders: Conversion between positions and counts.
            lying: Initial pose [rad], shape (n,).
        """
        self.servos, self.kind, self.chain = list(servos), servos[0].kind, ServoChain(servos)
        period = max(STEP, float(robot.spec().option.timestep))
        self.body = SimulatedBody(
            load_simulator(robot, period, effects=effects, threads=1), robot, self.servos, encoders
        )
        self.body.set_state(np.concatenate([lying, np.zeros(len(lying))]))

    @classmethod
    def ergojr(cls, effects: Sequence[Effect] = (), offsets: Sequence[int] = ()) -> Self:
        """Create an ErgoJr with factory settings, effects, and offsets of its horns [ticks], zero if empty."""
        joints = make_ergojr_joints(tuple(-offset for offset in offsets))
        robot = replace(find_robot("ergojr"), edit=_extend_limits)
        encoders = Encoders(joints.signs, joints.zeros, np.full(len(joints.ids), TICK))
        return cls(effects, [VirtualServo(identity) for identity in joints.ids], robot, encoders, LYING)

    @classmethod
    def of(cls, effects: Sequence[Effect], model: str, mounted: Sequence[MountedServo], lying: Sequence[float]) -> Self:
        """Create an arm of calibrated servos.

        Args:
            effects: Effects of the simulated arm that its model lacks.
            model: Name of a robot or a model file.
            mounted: One servo per joint.
            lying: Initial pose [rad], shape (n,).
        """
        known = find_robot(model)

        def extend(spec: mujoco.MjSpec) -> None:
            if known.edit:
                known.edit(spec)
            _extend_hinge_limits(spec)

        joints = tuple(one.joint for one in mounted)
        robot = replace(known, joints=joints, edit=extend)
        encoders = Encoders(
            np.array([one.sign for one in mounted]),
            np.array([one.zero for one in mounted]),
            np.array([find_kind(one.kind).tick for one in mounted]),
        )
        return cls(effects, [one.servo() for one in mounted], robot, encoders, np.array(lying))


def _extend_limits(spec: mujoco.MjSpec) -> None:
    """Extend the joint limits to the servos' range: only software enforces the arm's limits."""
    for joint in spec.joints:
        joint.range = np.array([-TURN, TURN])


def _extend_hinge_limits(spec: mujoco.MjSpec) -> None:
    """Extend the limits of hinges to half a turn in each direction, for the same reason."""
    for joint in spec.joints:
        if joint.type == mujoco.mjtJoint.mjJNT_HINGE:
            joint.range = np.array([-np.pi, np.pi])
