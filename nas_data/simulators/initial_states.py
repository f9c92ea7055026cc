"""Initial full states of rollouts: an arm in a measured pose, with unmeasured state that fits its load."""

from dataclasses import dataclass
from enum import IntEnum

import mujoco
import numpy as np

from nas_data.mjcf.actuator_lookup import BAND, DIRECT, GOAL, GOAL_GAIN, START, START_BAND, find_slow_goals
from nas_data.mjcf.stop_stiffness import compute_stop_stiffness
from nas_data.simulators.controls import CONTROLLERS, read_length_feedback
from nas_data.simulators.integrals import Integrals, compute_weight
from nas_data.simulators.layout import Layout
from nas_data.simulators.rest_states import compute_goal_leads, find_slewed_speeds, has_memory, settle_actuator

INTEGRATOR = int(mujoco.mjtDyn.mjDYN_INTEGRATOR)
START_SECONDS = 1.0  # [s] of an episode from which its initial loads are inferred
GRAVITY_ADVANTAGE = 0.8  # factor on the mean squared error of the initial load `GRAVITY`, the most likely one
WEIGHTLESS = 1e-4  # [N m] largest load that does not push play to one side


class InitialLoad(IntEnum):
    """Assumed initial load of a joint's servo, which is not measured."""

    GRAVITY = 0  # the gravity torque
    UNLOADED = 1  # no load
    MINUS_FRICTION = 2  # the gravity torque minus dry friction
    PLUS_FRICTION = 3  # the gravity torque plus dry friction


def choose_initial_loads(squares: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Return the initial load of each joint and episode that explains the first second best, shape (E, n).

    The share of gravity that friction holds, the side on which play lies and the place of a setpoint are not measured.

    Args:
        squares: Mean squared position errors in the first `START_SECONDS` [rad²; m²], shape (number of loads, E, n).
        noise: Standard deviation of the position readings [rad; m], shape (n,).
    """
    expected = squares + noise**2
    expected[InitialLoad.GRAVITY] *= GRAVITY_ADVANTAGE
    return np.asarray(expected.argmin(0))


@dataclass(frozen=True)
class GoalServo:
    """A servo with a goal joint, dead band and start torque, as `effects/edits/band.py` models it.

    Attributes:
        goal: Index of the goal joint in `qpos`.
        stiffness: Stiffness of the servo [N m/rad].
        half_width: Half width of the dead band [rad].
        start_torque: Torque just beyond the band [N m].
    """

    goal: int
    stiffness: float
    half_width: float
    start_torque: float

    def error(self, load: float) -> float:
        """Return the position error at which the servo holds a load [N m]: without a load, in the middle of the band.

        A load below the start torque is held at the band's edge.
        """
        if abs(load) < WEIGHTLESS:
            return load / self.stiffness
        beyond = abs(load) / self.stiffness if abs(load) > self.start_torque else 0.0
        return float(np.copysign(self.half_width + beyond, load))


def find_goal_servo(model: mujoco.MjModel, joint: int) -> GoalServo | None:
    """Return the servo of a joint, if it has a goal joint; else None."""
    name = model.joint(joint).name
    gain, *parts = (
        mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_ACTUATOR, name + part)
        for part in (GOAL_GAIN, BAND, START, START_BAND)
    )
    if gain < 0:
        return None
    band, start, inner = (float(model.actuator_forcerange[part, 1]) if part >= 0 else 0.0 for part in parts)
    stiffness, start_torque = -float(model.actuator_biasprm[gain, 1]), start - inner
    goal = int(model.joint(name + GOAL).qposadr[0])
    return GoalServo(goal, stiffness, (band - start_torque) / stiffness, start_torque)


class SettledStates:
    """Full states of a model that has long been held in a posture under its own weight.

    They differ from `RestStates` in three ways. Springs between servo and link are loaded. Play lies on the side to
    which the load pushes, or in the middle without a load. Delayed or slewing commands are those that hold the load.
    The share of the weight that dry friction holds is unknown; an `InitialLoad` for each joint states the assumption.
    """

    def __init__(
        self, model: mujoco.MjModel, layout: Layout, spec: int, period: float, data: mujoco.MjData | None = None
    ) -> None:
        """Prepare the states; arguments as for `RestStates`, the control period [s], and scratch data."""
        self.model, self.layout, self.spec, self.period = model, layout, spec, period
        self.data = data or mujoco.MjData(model)
        self.goal_servos = [find_goal_servo(model, int(joint)) for joint in model.dof_jntid[layout.dof]]
        self.slow_goals = list(zip(find_slow_goals(model), compute_goal_leads(model), strict=True))
        self.slewed, self.speed_setpoints = find_slewed_speeds(model, layout)
        self.stateful = [actuator for actuator in range(len(model.actuator_trntype)) if has_memory(model, actuator)]
        joints = range(len(layout.joints))
        self.hidden = [[a for a in np.flatnonzero(layout.position_map[i]) if a != layout.qpos[i]] for i in joints]
        feedbacks = [read_feedback_parameters(model, int(actuator)) for actuator in layout.inputs.actuators]
        self.stiffness, self.gear, gain, constant = np.array(feedbacks).reshape(-1, 4).T
        self.holding = layout.inputs.positional & (self.stiffness > 0)
        own = gain * layout.inputs.zero  # force that only defines the zero of the control's unit
        integrated = np.array([model.actuator_dyntype[a] == INTEGRATOR for a in layout.inputs.actuators], bool)
        self.setpoints = np.flatnonzero(integrated & (self.stiffness > 0))
        self.gain = gain
        self.integrals = Integrals.of(model, layout)
        self.drag = find_constant_drag(model, layout)
        self.rest = np.divide(constant + own, self.stiffness * self.gear, out=np.zeros_like(own), where=self.holding)

    def __call__(
        self, states: np.ndarray, initial_loads: np.ndarray, earlier_commands: np.ndarray | None = None
    ) -> np.ndarray:
        """Return full states (B, size) for measured states and initial loads.

        Args:
            states: Positions [rad] then velocities [rad/s], shape (B, 2n), or with the objects' states (B, 2n + m).
                Servos of objects hold the given positions.
            initial_loads: Initial load of each joint (an `InitialLoad`), shape (B, n).
            earlier_commands: Commands of the L control periods before the start in order, shape (B, L, n). They fill
                the delay lines. NaN if the arm had settled before; no commands if None.
        """
        known = np.empty((len(states), 0, initial_loads.shape[1])) if earlier_commands is None else earlier_commands
        rows = zip(np.asarray(states, float), initial_loads, known, strict=True)
        return np.stack([self.settle(*row) for row in rows])

    def settle(self, state: np.ndarray, initial_loads: np.ndarray, earlier_commands: np.ndarray) -> np.ndarray:
        """Return the full state (size,) for a measured state (2n or 2n + m,), loads (n,) and commands (L, n)."""
        model, data, n = self.model, self.data, len(self.layout.joints)
        objects = self.layout.objects
        mujoco.mj_resetData(model, data)
        data.qpos[self.layout.qpos] = state[:n]
        if len(state) > 2 * n:
            data.qpos[objects.qpos], data.qvel[objects.dof] = np.split(state[2 * n :], [len(objects.qpos)])
        followers = self.layout.followers
        if followers is not None:
            followers.place(data.qpos[None], data.qvel[None], from_reference=True)
        weight = compute_weight(model, data, data.qpos[None].copy(), followers)[0]
        loads = self.compute_loads(weight, initial_loads)
        for index in range(n):
            self.load_transmission(index, float(loads[index]))
        integrals = self.integrals.compute_held(loads)
        rests = loads.copy()
        rests[self.integrals.joints] -= self.integrals.gain * integrals
        holding = np.where(self.layout.inputs.positional, self.holding_commands(rests), 0.0)
        data.ctrl[:] = self.layout.controls(holding, state)
        for actuator in self.stateful:
            settle_actuator(model, data, actuator)
        data.act[self.integrals.addresses] = integrals
        self.load_setpoints(loads, initial_loads, state[n : 2 * n])
        if len(earlier_commands) and np.isfinite(earlier_commands).all():
            self.fill_delays(self.layout.controls(earlier_commands, state[None]))
        data.qvel[self.layout.dof] = state[n : 2 * n]
        for (goal, joint), lead in self.slow_goals:
            speed = data.qvel[model.jnt_dofadr[joint]]
            data.qvel[model.jnt_dofadr[goal]] = speed
            data.qpos[model.jnt_qposadr[goal]] += lead * speed
        data.act[self.speed_setpoints] = state[n + self.slewed] * self.layout.inputs.scale[self.slewed]
        if followers is not None:
            followers.place(data.qpos[None], data.qvel[None])
        full = np.empty(mujoco.mj_stateSize(model, self.spec))
        mujoco.mj_getState(model, data, full, self.spec)
        return full

    def fill_delays(self, controls: np.ndarray) -> None:
        """Fill the delay lines with the controls of the L control periods before the start, shape (L, nu)."""
        model, data = self.model, self.data
        for actuator in np.flatnonzero(model.actuator_history[:, 0]):
            first, inputs = model.actuator_ctrladr[actuator], model.actuator_ctrlnum[actuator]
            ages = model.opt.timestep * np.arange(int(model.actuator_history[actuator, 0]), 0, -1)
            periods = np.ceil(ages / self.period - 1e-6).astype(int)
            values = controls[np.maximum(len(controls) - periods, 0), first : first + inputs]
            mujoco.mj_initCtrlHistory(model, data, int(actuator), -ages[:, None], np.ascontiguousarray(values))

    def compute_loads(self, weight: np.ndarray, initial_loads: np.ndarray) -> np.ndarray:
        """Return the torques that the servos hold [N m], shape (n,), for gravity torques (nv,) and loads (n,)."""
        friction = np.maximum(self.model.dof_frictionloss[self.layout.dof], 2 * WEIGHTLESS)
        weights = weight[self.layout.dof]
        return np.select(
            [
                initial_loads == InitialLoad.UNLOADED,
                initial_loads == InitialLoad.MINUS_FRICTION,
                initial_loads == InitialLoad.PLUS_FRICTION,
            ],
            [np.zeros_like(weights), weights + self.drag - friction, weights + self.drag + friction],
            weights,
        )

    def load_transmission(self, index: int, load: float) -> None:
        """Deflect the hidden joints between a servo and its link under a load [N m]; the measured position stays."""
        model, data, own = self.model, self.data, self.layout.qpos[index]
        for address in self.hidden[index]:
            joint = int(np.flatnonzero(model.jnt_qposadr == address)[0])
            stiffness = float(model.jnt_stiffness[joint])
            turned = -load / stiffness if stiffness > 0 else 0.0
            if model.jnt_limited[joint]:
                low, high = model.jnt_range[joint]
                yielding = -load / compute_stop_stiffness(model, joint)
                pushed = 0.0 if abs(load) < WEIGHTLESS else yielding + (low if load > 0 else high)
                turned = float(np.clip(turned, low, high)) if stiffness > 0 else pushed
            data.qpos[address] = turned
            data.qpos[own] -= turned

    def load_setpoints(self, loads: np.ndarray, initial_loads: np.ndarray, velocities: np.ndarray) -> None:
        """Move the setpoints of integrated-velocity servos ahead of their joints, so that they hold a load.

        At a constant speed, damping of joint and servo is a load, too. Setpoints of servos without load stay where
        their joints are.

        Args:
            loads: Torques that the servos hold [N m; N], shape (n,).
            initial_loads: Assumed `InitialLoad` of each joint, shape (n,).
            velocities: Initial velocities [rad/s; m/s], shape (n,).
        """
        model, data = self.model, self.data
        for index in self.setpoints:
            if initial_loads[index] != InitialLoad.UNLOADED:
                actuator, gear = self.layout.inputs.actuators[index], self.gear[index]
                damping = float(model.dof_damping[self.layout.dof[index]])
                damping -= float(model.actuator_biasprm[actuator, 2]) * gear**2
                force = (float(loads[index]) + damping * float(velocities[index])) / gear
                data.act[model.actuator_actadr[actuator]] += force / self.gain[index]

    def holding_commands(self, loads: np.ndarray) -> np.ndarray:
        """Return the commanded positions (n,) at which the servos hold the loads (n,); saturation is neglected.

        The goal joint of a servo that has one is set accordingly.
        """
        commands = self.data.qpos[self.layout.qpos].copy()
        for index in np.flatnonzero(self.holding):
            load, stiffness, rest = float(loads[index]), self.stiffness[index], self.rest[index]
            if (servo := self.goal_servos[index]) is None:
                commands[index] += load / (stiffness * self.gear[index] ** 2) - rest
            else:
                commands[index] += servo.error(load) - rest
                self.data.qpos[servo.goal] = commands[index] + rest
        return commands


def read_feedback_parameters(model: mujoco.MjModel, actuator: int) -> tuple[float, float, float, float]:
    """Return an actuator's force per length error, gear, force per control, and constant force."""
    stiffness, gear = read_length_feedback(model, actuator), float(model.actuator_gear[actuator, 0])
    is_controller = model.actuator_gaintype[actuator] in CONTROLLERS
    gain = stiffness if is_controller else float(model.actuator_gainprm[actuator, 0])
    return stiffness, gear, gain, float(model.actuator_biasprm[actuator, 0])


def find_constant_drag(model: mujoco.MjModel, layout: Layout) -> np.ndarray:
    """Return the constant torques against the positive direction of passive actuators at the measured joints, (n,).

    They are the difference of friction by direction; see `effects/asymmetric_friction.py`.
    """
    passive = (model.actuator_ctrlnum == 0) & np.isin(model.actuator_trntype, DIRECT)
    joints = model.dof_jntid[layout.dof]
    owned = passive & (model.actuator_biastype == int(mujoco.mjtBias.mjBIAS_AFFINE))
    chosen = (model.actuator_trnid[:, 0] == joints[:, None]) & owned
    return np.asarray(-(chosen * (model.actuator_biasprm[:, 0] * model.actuator_gear[:, 0])).sum(axis=1))
