"""A whole simulated arm: its servos on one line, in one body."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Self

import mujoco
import numpy as np

from nas_data.effects.base import Effect
from nas_data.hardware.virtual_bus.body import Mounting, SimulatedBody
from nas_data.hardware.virtual_bus.chain import ServoChain
from nas_data.hardware.virtual_bus.kinds.base import find_kind
from nas_data.hardware.virtual_bus.servo import VirtualServo
from nas_data.hardware.xl320.ergojr import ergojr_joints
from nas_data.robots.base import Robot, find_robot
from nas_data.simulators.engines import load_simulator

LYING = np.array([0.2, -1.31, 0.72, -0.15, 0.94, 0.28])  # [rad] about Poppy's rest pose, as a hand would leave it
TURN = np.radians(150)  # [rad] from the middle to either end, XL-320 e-manual
STEP = 0.002  # [s] by which an arm advances, where its model's own step is not longer


@dataclass(frozen=True, kw_only=True)
class MountedServo:
    """A servo in its place, as a calibration left it.

    Attributes:
        joint: What it moves.
        kind: Its series, a file of `kinds/`.
        id: Its identity.
        zero: What its encoder counts where the joint is at zero.
        sign: 1 where the joint turns as the servo does, −1 otherwise.
        registers: What its control table holds beside the factory's values, by name.
    """

    joint: str
    kind: str
    id: int
    zero: float
    sign: int
    registers: dict[str, int]

    def servo(self) -> VirtualServo:
        """Take it out of its box, and set it up."""
        servo = VirtualServo(self.id, kind=find_kind(self.kind))
        for name, value in self.registers.items():
            servo.put(name, value)
        servo.kind.started(servo)
        return servo


@dataclass(frozen=True)
class Encoders:
    """How joints and encoders go together: see `Mounting`.

    Attributes:
        signs: Shape (n,).
        zeros: Counts where the joints are at zero, shape (n,).
        ticks: Angle of a count [rad], shape (n,).
    """

    signs: np.ndarray
    zeros: np.ndarray
    ticks: np.ndarray

    @classmethod
    def of(cls, mounted: Sequence[MountedServo]) -> Self:
        """Read them off servos in their places."""
        ticks = np.array([find_kind(one.kind).tick for one in mounted])
        return cls(np.array([one.sign for one in mounted]), np.array([one.zero for one in mounted]), ticks)

    def raw(self, positions: np.ndarray) -> np.ndarray:
        """Return encoder counts for positions [rad], shape (n,)."""
        return np.rint(self.signs * positions / self.ticks + self.zeros).astype(int)

    def positions(self, raw: np.ndarray) -> np.ndarray:
        """Return positions [rad] for encoder counts, shape (n,)."""
        return np.asarray(self.signs * (raw - self.zeros) * self.ticks)


class VirtualArm:
    """An arm of servos whose torque is off.

    Attributes:
        servos: In the order of the joints.
        kind: How the first of them is built, which speaks for the line.
        chain: The same on one line.
        body: What they move.
    """

    def __init__(
        self,
        effects: Sequence[Effect],
        servos: Sequence[VirtualServo],
        robot: Robot,
        joints: Mounting,
        lying: np.ndarray,
    ) -> None:
        """Assemble an arm.

        Args:
            effects: What the simulated arm has and its model lacks.
            servos: One a joint of the robot.
            robot: What they move.
            joints: How their positions are counted.
            lying: How a hand left it [rad], shape (n,).
        """
        self.servos, self.kind, self.chain = list(servos), servos[0].kind, ServoChain(servos)
        period = max(STEP, float(robot.spec().option.timestep))
        self.body = SimulatedBody(load_simulator(robot, period, effects=effects, threads=1), robot, self.servos, joints)
        self.body.set_state(np.concatenate([lying, np.zeros(len(lying))]))

    @classmethod
    def ergojr(cls, effects: Sequence[Effect] = (), offsets: Sequence[int] = ()) -> Self:
        """Take an ErgoJr out of the box: factory settings, identities 1 to 6.

        Args:
            effects: What the simulated arm has and its model lacks.
            offsets: Ticks by which the horns were mounted off the middle, one a servo; none where empty.
        """
        joints = ergojr_joints(tuple(-offset for offset in offsets))
        robot = replace(find_robot("ergojr"), edit=_free)
        return cls(effects, [VirtualServo(identity) for identity in joints.ids], robot, joints, LYING)

    @classmethod
    def of(cls, effects: Sequence[Effect], model: str, mounted: Sequence[MountedServo], lying: Sequence[float]) -> Self:
        """Put calibrated servos into a model.

        Args:
            effects: What the simulated arm has and its model lacks.
            model: The model, a robot's name or a file.
            mounted: One servo a joint.
            lying: How a hand left it [rad], shape (n,).
        """
        known = find_robot(model)
        joints = tuple(one.joint for one in mounted)
        robot = replace(known, joints=joints, edit=_in_turn(known.edit, _turn_freely))
        return cls(effects, [one.servo() for one in mounted], robot, Encoders.of(mounted), np.array(lying))


def _free(spec: mujoco.MjSpec) -> None:
    """Let the joints turn as far as a servo can: what keeps them within the arm's limits is software."""
    for joint in spec.joints:
        joint.range = np.array([-TURN, TURN])


def _turn_freely(spec: mujoco.MjSpec) -> None:
    """Let hinges turn by half a turn each way, for the same reason."""
    for joint in spec.joints:
        if joint.type == mujoco.mjtJoint.mjJNT_HINGE:
            joint.range = np.array([-np.pi, np.pi])


def _in_turn(
    first: Callable[[mujoco.MjSpec], None] | None, then: Callable[[mujoco.MjSpec], None]
) -> Callable[[mujoco.MjSpec], None]:
    def edit(spec: mujoco.MjSpec) -> None:
        if first:
            first(spec)
        then(spec)

    return edit
