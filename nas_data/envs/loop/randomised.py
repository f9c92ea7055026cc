"""Domain randomisation: masses, damping, friction, gains and delay are drawn for each episode."""

from collections.abc import Sequence

import mujoco
import numpy as np

from nas_data.dataset.features import EFFORT
from nas_data.effects.command_delay import CommandDelay
from nas_data.envs.loop.ranges import RANGES, Factors, Ranges
from nas_data.mjcf.actuator_lookup import (
    GOAL,
    GOAL_GAIN,
    find_goal_joints,
    find_servo_actuators,
    find_slow_goals,
)
from nas_data.simulators.base import Stepper
from nas_data.simulators.controls import command_range, find_command, read_length_feedback
from nas_data.simulators.mujoco import MujocoStepper

FIELDS = (
    "body_mass",
    "body_inertia",
    "dof_damping",
    "dof_frictionloss",
    "dof_armature",
    "actuator_gainprm",
    "actuator_biasprm",
    "actuator_forcerange",
    "actuator_delay",
)


def make_delay_line(ranges: Ranges = RANGES) -> CommandDelay:
    """Return the effect that adds buffers for the longest delay to a model's actuators."""
    return CommandDelay(delay=ranges.delay[1])


class RandomisedStepper(Stepper):
    """A batch of simulations, each with its own model per episode; implements `RandomizedStepper`."""

    def __init__(self, stepper: MujocoStepper, ranges: Ranges = RANGES) -> None:
        """Give every simulation its own parameters.

        Args:
            stepper: Batch of B simulations of a model with `make_delay_line`.
            ranges: Limits of the draws.
        """
        self.stepper, self.ranges = stepper, ranges
        self.joints, self.size = stepper.joints, stepper.size
        self.model = stepper.simulator.model
        self.fields = {name: stepper.batch.expand(name) for name in FIELDS}
        self._driven = stepper.layout.dof
        self._control, self._parts = find_controls(self.model, self.joints)
        slow = [goal for goal, _ in find_slow_goals(self.model)]
        self._slow_dofs = self.model.jnt_dofadr[slow]
        quick = [goal for goal in find_goal_joints(self.model) if goal not in slow]
        self._goal_dofs = self.model.jnt_dofadr[quick]
        names = [self.model.joint(goal).name.removesuffix(GOAL) for goal in quick]
        self._goal_gains = [self.model.actuator(name + GOAL_GAIN).id for name in names]
        self._torque = np.array([compute_largest_torque(self.model, joint) for joint in self.joints])

    def redraw(self, rngs: Sequence[np.random.Generator], rows: np.ndarray | None = None) -> None:
        """Draw the models of new episodes; see `RandomizedStepper`."""
        chosen = np.arange(self.size) if rows is None else np.asarray(rows)
        for row, rng in zip(chosen, rngs, strict=True):
            child = rng.spawn(1)[0]  # so that starts and goals equal those of the plain source with the same seed
            self.apply(int(row), self.ranges.draw(child, self.model, len(self.joints)))
        self.stepper.batch.set_const(chosen)

    def apply(self, row: int, drawn: Factors) -> None:
        """Write one simulation's parameters; `redraw` updates the values that the engine derives from them."""
        model, fields = self.model, self.fields
        fields["body_mass"][row] = model.body_mass * drawn.mass
        fields["body_inertia"][row] = model.body_inertia * drawn.mass[:, None]
        gain = np.append(drawn.gain, 1.0)[self._control]  # passive actuators that are no servo's keep theirs
        damping, armature = drawn.damping.copy(), drawn.armature.copy()
        damping[self._goal_dofs] = armature[self._goal_dofs] = gain[self._goal_gains]  # as quick as its servo
        armature[self._slow_dofs] = 1.0  # a profile keeps its acceleration
        fields["dof_damping"][row] = (model.dof_damping.T * damping).T
        fields["dof_armature"][row] = model.dof_armature * armature
        friction = model.dof_frictionloss * drawn.friction
        friction[self._driven] += drawn.drag * self._torque
        fields["dof_frictionloss"][row] = friction
        fields["actuator_gainprm"][row] = model.actuator_gainprm * gain[:, None]
        fields["actuator_biasprm"][row] = model.actuator_biasprm * gain[:, None]  # of a servo, the same gain
        fields["actuator_forcerange"][row] = model.actuator_forcerange
        for part in self._parts:  # a dead band's edge is where its gain has this torque
            fields["actuator_forcerange"][row][part] *= gain[part]
        fields["actuator_delay"][row] = drawn.delay

    @property
    def states(self) -> np.ndarray:
        """Positions [rad] then velocities [rad/s], shape (B, 2n)."""
        return self.stepper.states

    @property
    def objects(self) -> np.ndarray:
        """State of the objects, shape (B, m)."""
        return self.stepper.objects

    def reset(self, states: np.ndarray, rows: np.ndarray | None = None) -> None:
        """Reset simulations with their present models; see `Stepper.reset`."""
        self.stepper.reset(states, rows)

    def command_objects(self, targets: np.ndarray, rows: np.ndarray) -> None:
        """Command the servos of objects; see `Stepper.command_objects`."""
        self.stepper.command_objects(targets, rows)

    def step(self, commands: np.ndarray) -> np.ndarray:
        """Hold the commands for one control period; see `Stepper.step`."""
        return self.stepper.step(commands)

    def set_states(self, states: np.ndarray) -> None:
        """Set the joints' state; see `Stepper.set_states`."""
        self.stepper.set_states(states)

    def site_positions(self, name: str) -> np.ndarray:
        """Return the position of a site [m], shape (B, 3)."""
        return self.stepper.site_positions(name)


def find_controls(model: mujoco.MjModel, joints: Sequence[str]) -> tuple[np.ndarray, list[int]]:
    """Return the control that each actuator belongs to, -1 for none, and the passive actuators of servos.

    An actuator that only moves a goal of limited acceleration belongs to none.
    """
    controls = np.where(model.actuator_ctrlnum > 0, model.actuator_ctrladr, -1)
    parts: list[int] = []
    slow = {joint for _, joint in find_slow_goals(model)}
    for joint in (int(model.joint(name).id) for name in joints):
        servo = find_servo_actuators(model, joint)
        controls[servo] = model.actuator_ctrladr[servo[0]]
        if joint in slow:
            controls[servo[0]] = -1
        parts += servo[1:]
    return controls, parts


def compute_largest_torque(model: mujoco.MjModel, joint: str) -> float:
    """Return the largest torque of a joint's actuator [N·m]: its force limit, or gain times largest control."""
    index = model.joint(joint).id
    if model.jnt_actfrclimited[index]:  # also where a dead band moved the servo's limit to
        return float(np.abs(model.jnt_actfrcrange[index]).max())
    actuator, control = find_command(model, index, "the model")
    gear = abs(float(model.actuator_gear[actuator, 0]))
    if model.actuator_forcelimited[actuator]:
        return float(np.abs(model.actuator_forcerange[actuator]).max()) * gear
    most = float(np.abs(command_range(model, actuator, control)).max())
    return most if control.kind == EFFORT else most * read_length_feedback(model, actuator) * gear**2
