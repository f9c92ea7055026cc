"""Torque limit that falls with speed."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import mujoco

from nas_data.effects.base import Effect, Parameter, Scales, find_joint_actuator
from nas_data.effects.edits.band import add_sum
from nas_data.effects.edits.passive import add_passive, set_bias
from nas_data.effects.edits.servo import set_force_limit, set_joint_limit
from nas_data.errors import ModelFileError
from nas_data.mjcf.actuator_lookup import BAND, CURVE, SHARED


@dataclass(frozen=True, kw_only=True)
class MotorCurve(Effect):
    """The servo's torque limit falls linearly with speed, from `stall_torque` at rest to zero at `no_load_speed`.

    It is the back-EMF of a DC motor at a limited voltage. Torque that brakes is at most `stall_torque`. Below the limit
    the servo is unchanged. Both parameters are absolute, independent of the model's limits.

    With S = stall_torque, c = S / no_load_speed, v = dq/dt and the servo's torque τ, the model computes
    clip(clip(τ, ±S) + c · v, ±S) − c · v, which is the equation below. The inner clip is the actuator's force range,
    the outer one the joint's. A passive actuator gives + c · v, and the damping of a tendon − c · v. A joint's damping
    would not do: MuJoCo's Euler integrator treats it implicitly, so that both terms would not cancel below the limit.
    A servo with a dead band has no inner clip, so that it brakes with up to S + c · |v|.
    """

    stall_torque: float
    no_load_speed: float

    parameters: ClassVar = (
        Parameter("stall_torque", "N·m", 0.005, 5000.0, math.inf),
        Parameter("no_load_speed", "rad/s", 0.01, 1000.0, math.inf),
    )
    edit_order: ClassVar = -1  # before a torque limit, which may be lower than the stall torque
    equation: ClassVar = (
        "−S − c · min(v, 0) ≤ torque of the servo ≤ S − c · max(v, 0), v = dq/dt, S = stall_torque, "
        "c = stall_torque / no_load_speed"
    )
    source: ClassVar = "DC motor at a limited voltage: torque = kt / R · (voltage − ke · v); MuJoCo 4.0 <dcmotor>"
    signature: ClassVar = (
        "Big steps start with full torque and approach a top speed that falls with load; nothing on slow moves."
    )
    confused_with: ClassVar = ("torque_limit", "speed_limit", "viscous_friction")

    @property
    def is_neutral(self) -> bool:
        """Whether the torque is unlimited; the speed then has no effect."""
        return math.isinf(self.stall_torque)

    @classmethod
    def guesses(cls, scales: Scales) -> tuple[Mapping[str, float], ...]:
        """Half of the model's torque and all of it; no-load speeds slightly above the measured speed, and far above."""
        return tuple(
            {"stall_torque": share * scales.torque, "no_load_speed": ratio * scales.speed}
            for share in (0.5, 1.0)
            for ratio in (1.1, 2.5)
        )

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Limit the torques of actuator and joint, and add the speed-dependent pair, or change an existing one.

        Raises:
            JointMismatch: no actuator drives the joint.
            ModelFileError: its actuator acts through a tendon.
        """
        assert self.joint is not None
        actuator, joint, name = find_joint_actuator(spec, self.joint), spec.joint(self.joint), self.joint + CURVE
        if actuator.target == self.joint + SHARED:
            raise ModelFileError(
                f"No motor curve can be added to '{self.joint}', because its actuator acts through a tendon; give "
                'a model with an actuator of each joint: <position joint="…" kp="…"/>.'
            )
        set_joint_limit(joint, self.stall_torque)
        if spec.actuator(self.joint + BAND) is None:
            set_force_limit(actuator, self.stall_torque)
        slope = self.stall_torque / self.no_load_speed
        if spec.actuator(name) is None:
            add_passive(spec, name, mujoco.mjtTrn.mjTRN_TENDON, add_sum(spec, name, {self.joint: 1.0}))
        set_bias(spec.actuator(name), 0.0, per_speed=slope)
        spec.tendon(name).damping = [slope, 0.0, 0.0]
