"""Friction that grows with the torque a servo transmits."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import mujoco
import numpy as np

from nas_data.effects.base import Effect, Parameter, Scales, find_joint_actuator
from nas_data.effects.coulomb_friction import CoulombFriction
from nas_data.effects.edits.holding import stiffen_friction
from nas_data.effects.edits.hook import StepForces, StepHook
from nas_data.effects.edits.press import press_pad
from nas_data.mjcf.actuator_lookup import compute_leverage, find_servo_actuators


@dataclass(frozen=True, kw_only=True)
class LoadFriction(Effect):
    """Friction proportional to the torque of the joint's actuator, because load increases the contact forces of gears.

    A servo that holds a load presses its gears from both sides. Switched off, only the load presses them, half as much.
    With a `kinetic_ratio` below one it falls with speed, as lubricated gears do. In simulation a hook sets the friction
    before each physics step from the torques and speeds of the previous step. A model file expresses friction that does
    not fall, while the servo is on, by a pad that the servo presses (`PressedFriction`).
    """

    ratio: float
    kinetic_ratio: float = 1.0
    stribeck_velocity: float = 1.0

    parameters: ClassVar = (
        Parameter("ratio", "", 0.0, 0.9, 0.0),
        Parameter("kinetic_ratio", "", 0.2, 1.0, 1.0, spread=math.inf),
        Parameter("stribeck_velocity", "rad/s", 0.002, 5.0, 1.0, spread=math.inf),
    )
    in_model: ClassVar = False
    equation: ClassVar = (
        "friction = ratio · |torque of the servo| · f(dq/dt) · sign(dq/dt); switched off, ratio / 2 · |load|; "
        "f(v) = kinetic_ratio + (1 − kinetic_ratio) · exp(−(v / stribeck_velocity)²)"
    )
    source: ClassVar = (
        "Rhoban/bam, friction models M3 and M4, K_l · |τ_m − τ_ext| with τ_ext = −τ_m, or τ_m = 0; ratio = 2 K_l"
    )
    signature: ClassVar = "A jump at every reversal that grows with load: large in heavy postures, none where unloaded."
    confused_with: ClassVar = ("coulomb_friction", "stribeck_friction", "backlash", "torque_limit")

    @classmethod
    def guesses(cls, scales: Scales) -> tuple[Mapping[str, float], ...]:
        """A tenth and a third of the load; small gears have 0.12 to 0.29 (Rhoban/bam)."""
        return tuple({"ratio": ratio} for ratio in (0.1, 0.3))

    @classmethod
    def optional_guess(cls, scales: Scales | None) -> Mapping[str, float]:
        """Friction that falls to a half at a quarter of a radian per second."""
        return {"kinetic_ratio": 0.5, "stribeck_velocity": 0.25 * scales.radian} if scales else {}

    def nearest_in_model(self, scales: Scales) -> Effect:
        """Return constant friction equal to that under half of the large torque."""
        return CoulombFriction(joint=self.joint, torque=0.5 * self.ratio * scales.torque)

    def written_form(self, scales: Scales) -> Effect | None:
        """Return the same friction as a contact of a pad; None if it falls with speed."""
        if self.kinetic_ratio < 1:
            return None
        return PressedFriction(joint=self.joint, ratio=self.ratio, torque=scales.torque, speed=scales.speed)

    def expressible_part(self) -> Effect:
        """Return friction that does not fall with speed."""
        return replace(self, kinetic_ratio=1.0, stribeck_velocity=1.0)

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Stiffen the joint's friction constraint, whose torque the hook sets.

        Raises:
            JointMismatch: no actuator drives the joint.
        """
        assert self.joint is not None
        find_joint_actuator(spec, self.joint)
        stiffen_friction(spec, self.joint)

    @classmethod
    def hook(cls, effects: Sequence[Self], model: mujoco.MjModel) -> StepHook:
        """Return the hook that sets the friction of all joints with this effect."""
        ratios, levers = np.zeros(model.nv), np.zeros((model.nout, model.nv))
        most = np.full(model.nv, np.inf)
        falling: list[tuple[int, float, float]] = []  # degree of freedom, ratio at rest [1], Stribeck velocity [rad/s]
        for effect in effects:
            joint = model.joint(effect.joint).id
            dof = model.jnt_dofadr[joint]
            ratios[dof] += effect.ratio * effect.kinetic_ratio
            if effect.kinetic_ratio < 1:
                falling.append((dof, effect.ratio * (1 - effect.kinetic_ratio), effect.stribeck_velocity))
            for actuator in find_servo_actuators(model, joint):
                levers[model.actuator_outadr[actuator], dof] = compute_leverage(model, actuator, joint)
            if model.jnt_actfrclimited[joint]:
                most[dof] = np.abs(model.jnt_actfrcrange[joint]).max()

        def bind(step: StepForces) -> Callable[[], np.ndarray]:
            # this runs before every physics step: operating in place on all dofs, with tables as large as the batch,
            # takes a third of the time of indexing and broadcasting
            load = np.empty(step.bias.shape)
            largest, shares = np.broadcast_to(most, load.shape).copy(), np.broadcast_to(ratios, load.shape).copy()

            def friction() -> np.ndarray:
                np.dot(step.force, levers, out=load)
                np.abs(load, out=load)
                np.minimum(load, largest, out=load)
                if np.count_nonzero(step.released):
                    load[step.released] = 0.5 * np.abs(step.bias[step.released])
                present = shares.copy() if falling else shares
                for dof, ratio, velocity in falling:
                    present[:, dof] += ratio * np.exp(-((step.velocity[:, dof] / velocity) ** 2))
                return np.multiply(load, present, out=load)

            return friction

        return bind


@dataclass(frozen=True, kw_only=True)
class PressedFriction(LoadFriction):
    """The same friction for a model file, which cannot use a hook.

    Attributes:
        torque: Large torque of the servo [N·m].
        speed: Large speed of the joint [rad/s].
    """

    torque: float
    speed: float

    in_model: ClassVar = True
    edit_order: ClassVar = 3

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Add a pad that the servo presses against the link.

        Raises:
            JointMismatch: no actuator drives the joint.
            ModelFileError: the joint is no hinge, or not the only joint of its body.
        """
        super().edit(spec)
        assert self.joint is not None
        press_pad(spec, self.joint, self.ratio, self.torque, self.speed)

    @classmethod
    def hook(cls, effects: Sequence[Self], model: mujoco.MjModel) -> StepHook | None:  # type: ignore[override]
        """Return None: the model alone expresses it."""
