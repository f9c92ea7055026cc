"""A robot with effects, compiled for a control period; every engine starts from it."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from nas_data.effects.base import Effect, add_effects
from nas_data.effects.edits.hook import StepHook
from nas_data.errors import JointMismatch, ModelFileError, NasError
from nas_data.mjcf.bake_inertia import bake_inertia, rescales_masses
from nas_data.mjcf.measured_joints import mark_measured_joints
from nas_data.mjcf.timestep import set_timestep
from nas_data.robots.base import Robot, list_actuated_joints
from nas_data.simulators.hooks import find_hooks
from nas_data.simulators.layout import Layout
from nas_data.simulators.lock_joints import has_unmeasured_joints, lock_unmeasured_joints, refuse_ground_contact


@dataclass(frozen=True)
class CompiledRobot:
    """A compiled model and the indices of its joints.

    Attributes:
        robot: Robot without the effects.
        effects: Effects that were added.
        model: Compiled model.
        layout: Its measured joints.
        substeps: Physics steps per control period.
        hooks: Functions that run between physics steps.
    """

    robot: Robot
    effects: tuple[Effect, ...]
    model: mujoco.MjModel
    layout: Layout
    substeps: int
    hooks: tuple[StepHook, ...]

    @classmethod
    def of(
        cls, robot: Robot, period: float, joints: Sequence[str] | None, effects: Iterable[Effect]
    ) -> "CompiledRobot":
        """Compile a robot with effects.

        The model's physics timestep is shortened, if necessary, to a whole fraction of the control period.

        Args:
            robot: Model, joints and constants.
            period: Control period [s].
            joints: Joints to measure and command, by name; the robot's if None.
            effects: Effects to add to the model.

        Raises:
            JointMismatch: a joint is not in the model, or no actuator drives it.
            ModelFileError: the model with its effects does not compile.
        """
        effects = tuple(effects)
        spec = robot.spec()
        if rescales_masses(spec) and not all(effect.is_neutral for effect in effects):
            spec = bake_inertia(spec)
        substeps = max(1, math.ceil(period / spec.option.timestep - 1e-6))
        set_timestep(spec, period / substeps)
        joints = joints or robot.joints
        mark_measured_joints(spec, joints, list_actuated_joints(spec))
        if not robot.adapted and has_unmeasured_joints(spec, joints):
            lock_unmeasured_joints(spec, joints, str(robot.mjcf), commanded=True)
        try:
            add_effects(spec, effects)
            model = spec.compile()
        except NasError:
            raise
        except (ValueError, mujoco.FatalError) as error:
            raise ModelFileError(f"{robot.mjcf} does not compile with its effects: {error}") from None
        layout = Layout.of(model, joints, str(robot.mjcf))
        if robot.bases:
            refuse_ground_contact(model, layout, np.zeros((1, len(joints))), str(robot.mjcf))
        return cls(robot, effects, model, layout, substeps, find_hooks(effects, model))

    @property
    def remembers(self) -> bool:
        """Whether the state has unmeasured parts: play, a spring, an actuator state or a delayed command."""
        hidden = self.model.nq > len(self.layout.joints) + len(self.layout.objects.qpos) or self.model.na > 0
        return bool(hidden or (self.model.actuator_history[:, 0] > 0).any())

    @property
    def slides(self) -> tuple[str, ...]:
        """Names of the measured joints that are slides."""
        slide = int(mujoco.mjtJoint.mjJNT_SLIDE)
        return tuple(joint for joint in self.layout.joints if int(self.model.joint(joint).type[0]) == slide)

    def check(self, states: np.ndarray, commands: np.ndarray) -> None:
        """Check the widths of states (…, 2n or 2n + m) and commands (…, n).

        Raises:
            JointMismatch: a width differs.
        """
        joints = self.layout.joints
        n, m = len(joints), self.layout.objects.width
        if states.shape[-1] not in {2 * n, 2 * n + m} or commands.shape[-1] != n:
            scene = f"{2 * n}, or {2 * n + m} with the objects," if m else f"{2 * n}"
            raise JointMismatch(
                f"States of {states.shape[-1]} and commands of {commands.shape[-1]} components do not fit "
                f"{n} joints ({', '.join(joints)}): {scene} and {n} are needed."
            )

    def describe(self, engine: str, version: str) -> dict[str, object]:
        """Return the description of the source for provenance."""
        return {
            "name": self.robot.name,
            "sha256": self.robot.sha256,
            "engine": engine,
            "engine_version": version,
            "timestep": self.model.opt.timestep,
            "substeps": self.substeps,
            "effects": [effect.to_json(self.slides) for effect in self.effects],
        }
