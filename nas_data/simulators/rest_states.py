"""Full MuJoCo states of a model at rest in any posture."""

from dataclasses import dataclass

import mujoco
import numpy as np

from nas_data.dataset.features import VELOCITY
from nas_data.mjcf.actuator_lookup import DAMPING, GOAL_GAIN, find_driving_actuators, find_slow_goals
from nas_data.simulators.controls import read_length_feedback
from nas_data.simulators.followers import Slack
from nas_data.simulators.integrals import Integrals, compute_weight
from nas_data.simulators.layout import Layout

SLEW_RATES = {mujoco.mjtDyn.mjDYN_PID: 1, mujoco.mjtDyn.mjDYN_DCMOTOR: 7}  # index of the slew rate in `dynprm`
BEFORE_ACT = mujoco.mjtState.mjSTATE_TIME | mujoco.mjtState.mjSTATE_QPOS | mujoco.mjtState.mjSTATE_QVEL


@dataclass(frozen=True)
class CarriedState:
    """State of B simulations that is not measured, and that one recorded row passes on to the next.

    Attributes:
        setpoints: Setpoints of servos whose control is the speed of the setpoint, then integral parts of position
            servos, shape (B, servos).
        slack: Slack of the followers; None if the model has none.
    """

    setpoints: np.ndarray
    slack: Slack | None

    def select(self, rows: np.ndarray) -> "CarriedState":
        """Return the state of some rows."""
        return CarriedState(self.setpoints[rows], None if self.slack is None else self.slack.select(rows))


class RestStates:
    """Full states of a model at rest, with setpoints and delay lines filled.

    They are linear in the measured states. MuJoCo computes the basis once, and states are combinations of it. Setpoints
    with a limited acceleration move at the measured speed. Only integral parts of servos depend on the posture
    otherwise: they hold the arm's weight.
    """

    def __init__(self, model: mujoco.MjModel, layout: Layout, spec: int) -> None:
        """Prepare the states.

        Args:
            model: Compiled model.
            layout: Its measured joints.
            spec: State components (`mjtState`); warm start and applied forces are zero.
        """
        self.layout = layout
        self.base = rest_state(model, layout, np.zeros(len(layout.joints)), spec)
        unit = np.eye(len(layout.joints))
        self.slopes = np.stack([rest_state(model, layout, row, spec) - self.base for row in unit])
        self.velocity = find_velocity_slice(model, spec)
        self.position = self.velocity.start - model.nq
        self.reference = model.qpos0[layout.objects.qpos]
        servos = range(len(layout.objects.servos))
        self.object_slopes = [rest_state(model, layout, np.zeros(len(unit)), spec, i) - self.base for i in servos]
        first = mujoco.mj_stateSize(model, int(BEFORE_ACT))
        self.integrals, self.scratch = Integrals.of(model, layout), mujoco.MjData(model)
        self.setpoints = first + np.append(find_integrator_setpoints(model, layout), self.integrals.addresses)
        pairs = np.array(find_slow_goals(model), int).reshape(-1, 2)
        self.goal_dofs, self.goal_sources = self.velocity.start + model.jnt_dofadr[pairs].T
        self.goals, self.goal_leads = self.position + model.jnt_qposadr[pairs[:, 0]], compute_goal_leads(model)
        self.slewed, places = find_slewed_speeds(model, layout)
        self.speed_setpoints, self.speed_scales = first + places, layout.inputs.scale[self.slewed]

    @property
    def carries_state(self) -> bool:
        """Whether a row passes unmeasured state on to the next (see `CarriedState`)."""
        return self.layout.followers is not None or bool(len(self.setpoints))

    def carry(self, full: np.ndarray) -> CarriedState:
        """Return the unmeasured state that full states (B, size) pass on to the next rows."""
        slack = None
        if self.layout.followers is not None:
            slack = self.layout.followers.measure_slack(*self.motion(full))
        return CarriedState(full[:, self.setpoints], slack)

    def motion(self, full: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return views of `qpos` (B, nq) and `qvel` (B, nv) in full states (B, size)."""
        return full[:, self.position : self.velocity.start], full[:, self.velocity]

    def __call__(self, states: np.ndarray, carried: CarriedState | None = None) -> np.ndarray:
        """Return full states (B, size) for measured states.

        Args:
            states: Positions [rad], velocities [rad/s] and object states, shape (B, 2n or 2n + m).
            carried: Unmeasured state from the rows before; at rest if None.
        """
        n = len(self.layout.joints)
        full = self.base + states[:, :n] @ self.slopes
        full[:, self.velocity.start + self.layout.dof] = states[:, n : 2 * n]
        full[:, self.goal_dofs] = full[:, self.goal_sources]
        full[:, self.goals] += self.goal_leads * full[:, self.goal_sources]
        full[:, self.speed_setpoints] = states[:, n + self.slewed] * self.speed_scales
        if states.shape[1] > 2 * n:
            self._set_objects(full, states[:, 2 * n :])
        followers = self.layout.followers
        if carried is not None:
            full[:, self.setpoints] = carried.setpoints
        if followers is not None and carried is not None and carried.slack is not None:
            followers.place_with_slack(carried.slack, *self.motion(full))
        elif followers is not None:
            followers.place(*self.motion(full), from_reference=True)
        if carried is None and self.integrals:
            self._wind_integrals(full)
        return full

    def _wind_integrals(self, full: np.ndarray) -> None:
        """Set the integral parts of servos in full states (B, size) to those that hold the arm's weight."""
        places = self.setpoints[-len(self.integrals.joints) :]
        weights = compute_weight(self.scratch.model, self.scratch, self.motion(full)[0], self.layout.followers)
        for row, weight in zip(full, weights, strict=True):
            row[places] = self.integrals.compute_held(weight[self.layout.dof])

    def _set_objects(self, full: np.ndarray, states: np.ndarray) -> None:
        """Write object states (B, m) into full states (B, size); servos of objects hold the given positions."""
        objects = self.layout.objects
        count = len(objects.qpos)
        for index, slope in zip(objects.servos, self.object_slopes, strict=True):
            full += (states[:, index] - self.reference[index])[:, None] * slope
        full[:, self.position + objects.qpos] = states[:, :count]
        full[:, self.velocity.start + objects.dof] = states[:, count:]


def find_velocity_slice(model: mujoco.MjModel, spec: int) -> slice:
    """Return the position of `qvel` in a state vector that also holds time and `qpos`."""
    before = spec & int(mujoco.mjtState.mjSTATE_TIME | mujoco.mjtState.mjSTATE_QPOS)
    start = mujoco.mj_stateSize(model, before)
    return slice(start, start + model.nv)


def rest_state(
    model: mujoco.MjModel, layout: Layout, positions: np.ndarray, spec: int, moved: int | None = None
) -> np.ndarray:
    """Return the state of a model after long holding the measured positions, shape (size,).

    Args:
        model: Compiled model.
        layout: Its measured joints.
        positions: Measured and commanded positions [rad], shape (n,).
        spec: State components (`mjtState`).
        moved: Index of an object servo whose command is one unit above its reference; none if None.
    """
    data = mujoco.MjData(model)
    data.qpos[layout.qpos] = positions
    data.ctrl[:] = layout.controls(np.where(layout.inputs.positional, positions, 0.0))
    if moved is not None:
        data.ctrl[layout.objects.control[moved]] += layout.objects.inputs.scale[moved]
    for actuator in range(len(model.actuator_trntype)):
        settle_actuator(model, data, actuator)
    settle_slow_goals(model, data)
    state = np.empty(mujoco.mj_stateSize(model, spec))
    mujoco.mj_getState(model, data, state, spec)
    return state


def has_memory(model: mujoco.MjModel, actuator: int) -> bool:
    """Whether an actuator has state: a delay line, a slewing setpoint, a filter or an integrator."""
    return bool(model.actuator_history[actuator, 0] or model.actuator_actnum[actuator])


def settle_actuator(model: mujoco.MjModel, data: mujoco.MjData, actuator: int) -> None:
    """Set an actuator's state (delay line, slewing setpoint, filter, integrator) to that after a long held control."""
    inputs = model.actuator_ctrlnum[actuator]
    if not inputs:
        return
    first = model.actuator_ctrladr[actuator]
    control = data.ctrl[first : first + inputs].copy()
    samples = int(model.actuator_history[actuator, 0])
    if samples:
        mujoco.mj_initCtrlHistory(model, data, actuator, None, np.tile(control, (samples, 1)))
    kind = mujoco.mjtDyn(model.actuator_dyntype[actuator])
    slews = kind in SLEW_RATES and model.actuator_dynprm[actuator, SLEW_RATES[kind]] > 0
    filters = kind in (mujoco.mjtDyn.mjDYN_FILTER, mujoco.mjtDyn.mjDYN_FILTEREXACT)
    if slews or filters:
        data.act[model.actuator_actadr[actuator]] = control[0]
    elif kind == mujoco.mjtDyn.mjDYN_INTEGRATOR and model.actuator_biasprm[actuator, 1] < 0:
        mujoco.mj_fwdPosition(model, data)  # computes the actuator length, where the setpoint is at rest
        length = data.actuator_length[model.actuator_outadr[actuator]]
        feedback = -model.actuator_biasprm[actuator, 1] / model.actuator_gainprm[actuator, 0]
        data.act[model.actuator_actadr[actuator]] = feedback * length


def settle_slow_goals(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Move goal joints with a limited acceleration to where their servos hold them."""
    for goal, joint in find_slow_goals(model):
        servo = int(find_driving_actuators(model, joint)[0])
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_fwdActuation(model, data)
        force = data.actuator_force[model.actuator_outadr[servo]]
        stiffness = read_length_feedback(model, servo) * model.actuator_gear[servo, 0]
        data.qpos[model.jnt_qposadr[goal]] += force / stiffness


def compute_goal_leads(model: mujoco.MjModel) -> np.ndarray:
    """Return the time by which goals of limited acceleration lead their joints at constant speed [s], shape (k,).

    It is the damping over the stiffness of the servo.
    """
    leads = []
    for _, joint in find_slow_goals(model):
        name = model.joint(joint).name
        damper = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_ACTUATOR, name + DAMPING)
        damping = float(model.dof_damping[model.jnt_dofadr[joint]])
        damping -= float(model.actuator_biasprm[damper, 2]) if damper >= 0 else 0.0
        leads.append(-damping / float(model.actuator(name + GOAL_GAIN).biasprm[1]))
    return np.array(leads)


def find_slewed_speeds(model: mujoco.MjModel, layout: Layout) -> tuple[np.ndarray, np.ndarray]:
    """Return the joints whose commanded speed changes at a limited rate, and the indices of these speeds in `act`.

    Shapes (k,) and (k,).
    """
    found = [
        (index, int(model.actuator_actadr[actuator]))
        for index, (actuator, kind) in enumerate(zip(layout.inputs.actuators, layout.kinds, strict=True))
        if kind == VELOCITY
        and model.actuator_dyntype[actuator] == int(mujoco.mjtDyn.mjDYN_DCMOTOR)
        and model.actuator_dynprm[actuator, SLEW_RATES[mujoco.mjtDyn.mjDYN_DCMOTOR]] > 0
    ]
    joints, places = np.array(found, int).reshape(-1, 2).T
    return joints, places


def find_integrator_setpoints(model: mujoco.MjModel, layout: Layout) -> np.ndarray:
    """Return the indices in `act` of setpoints whose speed is the joint's command, shape (servos,)."""
    driving = np.isin(model.actuator_ctrladr, layout.control) & (model.actuator_ctrlnum > 0)
    moving = model.actuator_dyntype == int(mujoco.mjtDyn.mjDYN_INTEGRATOR)
    return np.asarray(model.actuator_actadr[driving & moving], dtype=int)
