"""Friction that grows with the torque a servo transmits."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np

from nas_data.drives import leverage, servo_actuators
from nas_data.effects.base import Effect, Parameter, Scales, joint_actuator
from nas_data.effects.coulomb_friction import CoulombFriction
from nas_data.effects.edits.holding import hold_firmly
from nas_data.effects.edits.hook import StepForces, StepHook


@dataclass(frozen=True, kw_only=True)
class LoadFriction(Effect):
    """Gears press harder under load: friction in proportion to the torque that the joint's actuator gives.

    A servo that holds a load has its gears pressed from both sides. Switched off, it is pressed by the load alone, and
    half as hard. MJCF cannot express it: friction is set anew before each physics step, from the torques in the last.
    """

    ratio: float

    parameters: ClassVar = (Parameter("ratio", "", 0.0, 0.9, 0.0),)
    in_model: ClassVar = False
    equation: ClassVar = "friction = ratio · |torque of the servo| · sign(dq/dt); switched off, ratio / 2 · |load|"
    source: ClassVar = "Rhoban/bam, friction model M3, K_l · |τ_m − τ_ext| with τ_ext = −τ_m, or τ_m = 0; ratio = 2 K_l"
    signature: ClassVar = "A jump at every reversal that grows with load: large in heavy postures, none where unloaded."
    confused_with: ClassVar = ("coulomb_friction", "stribeck_friction", "backlash", "torque_limit")

    @classmethod
    def guesses(cls, scales: Scales) -> tuple[Mapping[str, float], ...]:
        """A tenth and a third of the load, the range of small gears (Rhoban/bam: 0.12 to 0.29)."""
        return tuple({"ratio": ratio} for ratio in (0.1, 0.3))

    def native(self, scales: Scales) -> Effect:
        """Return constant friction of the size that this has under half of a large torque."""
        return CoulombFriction(joint=self.joint, torque=0.5 * self.ratio * scales.torque)

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Let the joint's friction hold rather than creep.

        Raises:
            JointMismatch: no actuator drives the joint.
        """
        assert self.joint is not None
        joint_actuator(spec, self.joint)
        hold_firmly(spec, self.joint)

    def hook(self, model: mujoco.MjModel) -> StepHook:
        """Return what sets the friction."""
        assert self.joint is not None
        joint = model.joint(self.joint).id
        servo = servo_actuators(model, joint)
        forces = model.actuator_outadr[servo]
        levers = np.array([leverage(model, actuator, joint) for actuator in servo])
        most = np.abs(model.jnt_actfrcrange[joint]).max() if model.jnt_actfrclimited[joint] else np.inf
        dof = int(model.jnt_dofadr[joint])

        def add_friction(step: StepForces) -> None:
            torque = np.minimum(abs(step.force[:, forces] @ levers), most)
            load = np.where(step.released, 0.5 * abs(step.bias[:, dof]), torque)
            step.friction[:, dof] += self.ratio * load

        return add_friction
