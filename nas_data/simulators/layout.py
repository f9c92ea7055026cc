"""Where the measured joints live in a compiled MuJoCo model, and the state of the model at rest in any posture."""

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from nas_data.dataset.features import POSITION
from nas_data.errors import JointMismatch, ModelFileError
from nas_data.simulators.controls import Controls, UntoldControl, find_command, length_control
from nas_data.simulators.followers import Followers, Slack
from nas_data.simulators.objects import Objects

SLEW_RATES = {mujoco.mjtDyn.mjDYN_PID: 1, mujoco.mjtDyn.mjDYN_DCMOTOR: 7}  # where in `dynprm` the limit stands
FULLPHYSICS = int(mujoco.mjtState.mjSTATE_FULLPHYSICS)
INTEGRATION = int(mujoco.mjtState.mjSTATE_INTEGRATION)
BEFORE_MEMORY = mujoco.mjtState.mjSTATE_TIME | mujoco.mjtState.mjSTATE_QPOS | mujoco.mjtState.mjSTATE_QVEL


@dataclass(frozen=True)
class Layout:
    """Indices and linear maps of n measured joints in a model with nq positions, nv speeds and nu controls.

    Attributes:
        joints: Names of the measured joints.
        qpos: Index of each joint in `qpos`, shape (n,).
        dof: Index of each joint in `qvel`, shape (n,).
        inputs: What each joint is commanded, and its control for that.
        position_map: Measured positions = position_map @ qpos, shape (n, nq); more than one entry a row where
            play or compliance adds to the servo's angle.
        velocity_map: Measured velocities = velocity_map @ qvel, shape (n, nv).
        reference: Controls that hold the model at its reference posture, shape (nu,).
        followers: Joints that constraints make follow the measured ones; None where there are none.
        objects: What moves beside the measured joints.
    """

    joints: tuple[str, ...]
    qpos: np.ndarray
    dof: np.ndarray
    inputs: Controls
    position_map: np.ndarray
    velocity_map: np.ndarray
    reference: np.ndarray
    followers: Followers | None
    objects: Objects

    @classmethod
    def of(cls, model: mujoco.MjModel, joints: Sequence[str], name: str) -> "Layout":
        """Find joints and their actuators by name.

        Args:
            model: Compiled model.
            joints: Measured joints.
            name: What to call the model in an error.

        Raises:
            JointMismatch: the model lacks a joint, or nothing drives it.
            ModelFileError: it cannot be told what an actuator is asked for.
        """
        indices = np.array([joint_index(model, joint, name) for joint in joints], dtype=int)
        inputs = Controls.of(model, indices, name)
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        positions, velocities = readout(model, joints, indices)
        dof = model.jnt_dofadr[indices].astype(int)
        followers = Followers.of(model, np.union1d(dof, np.flatnonzero(velocities.any(axis=0))))
        driven = indices if followers is None else np.concatenate([indices, followers.joints])
        return cls(
            joints=tuple(joints),
            qpos=model.jnt_qposadr[indices].astype(int),
            dof=dof,
            inputs=inputs,
            position_map=positions,
            velocity_map=velocities,
            reference=reference_controls(model, data),
            followers=followers,
            objects=Objects.of(model, driven, inputs.actuators, data),
        )

    @property
    def control(self) -> np.ndarray:
        """Index of each joint's actuator in `ctrl`, shape (n,)."""
        return self.inputs.index

    @property
    def kinds(self) -> tuple[str, ...]:
        """What each joint is commanded: `.pos`, `.vel` or `.effort`."""
        return self.inputs.kinds

    def measure(self, qpos: np.ndarray, qvel: np.ndarray) -> np.ndarray:
        """Return positions [rad] then velocities [rad/s], shape (…, 2n), from qpos (…, nq) and qvel (…, nv)."""
        return np.concatenate([qpos @ self.position_map.T, qvel @ self.velocity_map.T], axis=-1)

    def controls(self, commands: np.ndarray, first: np.ndarray | None = None) -> np.ndarray:
        """Return controls (…, nu) for commands (…, n); actuators of other joints hold still.

        Args:
            commands: What each joint is asked for (see `kinds`).
            first: States in which simulations start, shape (…, 2n or 2n + m); those of objects are held where they
                are given, at their reference elsewhere.
        """
        controls = np.empty((*commands.shape[:-1], len(self.reference)))
        controls[...] = self.reference
        controls[..., self.control] = self.inputs.of_commands(commands)
        if first is not None and first.shape[-1] > 2 * len(self.joints) and len(self.objects.control):
            held = first[..., 2 * len(self.joints) + self.objects.servos]
            controls[..., self.objects.control] = self.objects.inputs.of_commands(held)
        return controls


def joint_index(model: mujoco.MjModel, joint: str, name: str) -> int:
    """Return the index of a hinge or slide joint by its name."""
    index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, joint)
    if index < 0:
        names = ", ".join(model.joint(i).name for i in range(model.njnt))
        raise JointMismatch(f"{name} has no joint '{joint}'; it has: {names}. Joints are matched by name.")
    if mujoco.mjtJoint(model.jnt_type[index]) not in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE):
        raise JointMismatch(f"The joint '{joint}' of {name} is neither hinge nor slide; only those are measured.")
    return index


def actuator_index(model: mujoco.MjModel, joint: int, name: str) -> int:
    """Return the index of the actuator that commands a joint; errors as of `find_command`."""
    return find_command(model, joint, name)[0]


def readout(model: mujoco.MjModel, joints: Sequence[str], indices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the maps from qpos and qvel to what is measured, shapes (n, nq) and (n, nv).

    A sensor named `<joint>.pos` says what is measured: a joint's position or a fixed tendon's length (servo angle
    plus play). Without one, the joint itself is.
    """
    positions = np.zeros((len(joints), model.nq))
    velocities = np.zeros((len(joints), model.nv))
    for row, (joint, index) in enumerate(zip(joints, indices, strict=True)):
        for member, share in measured_joints(model, joint, int(index)):
            positions[row, model.jnt_qposadr[member]] += share
            velocities[row, model.jnt_dofadr[member]] += share
    return positions, velocities


def measured_joints(model: mujoco.MjModel, joint: str, index: int) -> list[tuple[int, float]]:
    """Return the joints, with their shares, whose sum is measured under a joint's name."""
    sensor = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SENSOR, joint + POSITION)
    if sensor < 0:
        return [(index, 1.0)]
    kind, target = mujoco.mjtSensor(model.sensor_type[sensor]), int(model.sensor_objid[sensor])
    if kind == mujoco.mjtSensor.mjSENS_JOINTPOS:
        return [(target, 1.0)]
    if kind == mujoco.mjtSensor.mjSENS_TENDONPOS:
        wraps = range(model.tendon_adr[target], model.tendon_adr[target] + model.tendon_num[target])
        if all(model.wrap_type[wrap] == int(mujoco.mjtWrap.mjWRAP_JOINT) for wrap in wraps):
            return [(int(model.wrap_objid[wrap]), float(model.wrap_prm[wrap])) for wrap in wraps]
    raise ModelFileError(f"The sensor '{joint}{POSITION}' must be the position of a joint or of a fixed tendon.")


def reference_controls(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """Return controls (nu,) at which position actuators rest at the model's reference posture; others are zero.

    Args:
        model: Compiled model.
        data: At the reference posture, forward kinematics done.
    """
    controls = np.zeros(model.nu)
    for actuator in np.flatnonzero(model.actuator_ctrlnum).tolist():
        with contextlib.suppress(UntoldControl):
            control = length_control(model, actuator)
            if control.kind == POSITION:
                length = float(data.actuator_length[model.actuator_outadr[actuator]])
                controls[model.actuator_ctrladr[actuator]] = control.scale * length + control.zero
    return controls


def as_slice(indices: np.ndarray) -> np.ndarray | slice:
    """Return indices that follow each other as a slice, which numpy reads and writes several times faster."""
    first = int(indices[0])
    consecutive = np.array_equal(indices, np.arange(first, first + len(indices)))
    return slice(first, first + len(indices)) if consecutive else indices


@dataclass(frozen=True)
class Kept:
    """What of B simulations no joint's measurement tells, and the rows before do.

    Attributes:
        setpoints: Of servos whose control is the speed of their setpoint, shape (B, servos).
        slack: Of the followers; None where there are none.
    """

    setpoints: np.ndarray
    slack: Slack | None

    def of_rows(self, rows: np.ndarray) -> "Kept":
        """Return that of some rows."""
        return Kept(self.setpoints[rows], None if self.slack is None else self.slack.of_rows(rows))


class RestStates:
    """The full state of a model that has been at rest in a posture: setpoints, delays and all.

    Everything in it is linear in the measured positions, so it is built once by the engine and then scaled.
    """

    def __init__(self, model: mujoco.MjModel, layout: Layout, spec: int) -> None:
        """Prepare the states.

        Args:
            model: Compiled model.
            layout: Its measured joints.
            spec: Which part of the state (an `mjtState`); warm start and applied forces are zero.
        """
        self.layout = layout
        self.base = rest_state(model, layout, np.zeros(len(layout.joints)), spec)
        unit = np.eye(len(layout.joints))
        self.slopes = np.stack([rest_state(model, layout, row, spec) - self.base for row in unit])
        self.velocity = slice_of_velocity(model, spec)
        self.position = self.velocity.start - model.nq
        self.reference = model.qpos0[layout.objects.qpos]
        held = range(len(layout.objects.servos))
        self.held = [rest_state(model, layout, np.zeros(len(unit)), spec, place) - self.base for place in held]
        first = mujoco.mj_stateSize(model, int(BEFORE_MEMORY))
        self.setpoints = first + integrators(model, layout)

    @property
    def kept(self) -> bool:
        """Whether consecutive rows have something in common that is not measured (see `Kept`)."""
        return self.layout.followers is not None or bool(len(self.setpoints))

    def keep(self, full: np.ndarray) -> "Kept":
        """Return what full states (B, size) hand on to the rows that follow."""
        slack = None
        if self.layout.followers is not None:
            slack = self.layout.followers.slack(*self.motion(full))
        return Kept(full[:, self.setpoints], slack)

    def motion(self, full: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the parts of full states (B, size) that are `qpos` and `qvel`, as views."""
        return full[:, self.position : self.velocity.start], full[:, self.velocity]

    def __call__(self, states: np.ndarray, kept: "Kept | None" = None) -> np.ndarray:
        """Return full states (B, size) for positions [rad] then velocities [rad/s], and objects (B, 2n or 2n + m).

        Args:
            states: Shape (B, 2n or 2n + m).
            kept: What the rows before hand on; at rest where None.
        """
        n = len(self.layout.joints)
        full = self.base + states[:, :n] @ self.slopes
        full[:, self.velocity.start + self.layout.dof] = states[:, n : 2 * n]
        if states.shape[1] > 2 * n:
            self.place(full, states[:, 2 * n :])
        followers = self.layout.followers
        if kept is not None:
            full[:, self.setpoints] = kept.setpoints
        if followers is not None and kept is not None and kept.slack is not None:
            followers.place_with(kept.slack, *self.motion(full))
        elif followers is not None:
            followers.place(*self.motion(full), far=True)
        return full

    def place(self, full: np.ndarray, states: np.ndarray) -> None:
        """Put objects (B, m) into full states (B, size), those with servos held where they are."""
        objects = self.layout.objects
        count = len(objects.qpos)
        for place, held in zip(objects.servos, self.held, strict=True):
            full += (states[:, place] - self.reference[place])[:, None] * held
        full[:, self.position + objects.qpos] = states[:, :count]
        full[:, self.velocity.start + objects.dof] = states[:, count:]


def slice_of_velocity(model: mujoco.MjModel, spec: int) -> slice:
    """Return where `qvel` lies in a state vector that also holds time and `qpos`."""
    before = spec & int(mujoco.mjtState.mjSTATE_TIME | mujoco.mjtState.mjSTATE_QPOS)
    start = mujoco.mj_stateSize(model, before)
    return slice(start, start + model.nv)


def rest_state(
    model: mujoco.MjModel, layout: Layout, positions: np.ndarray, spec: int, moved: int | None = None
) -> np.ndarray:
    """Return the state of a model that has long been commanded to the measured positions [rad], shape (size,).

    Args:
        model: Compiled model.
        layout: Its measured joints.
        positions: Shape (n,).
        spec: Which part of the state.
        moved: Which of the objects' servos has long been commanded one unit further than its reference; none if None.
    """
    data = mujoco.MjData(model)
    data.qpos[layout.qpos] = positions
    data.ctrl[:] = layout.controls(np.where(layout.inputs.positional, positions, 0.0))
    if moved is not None:
        data.ctrl[layout.objects.control[moved]] += layout.objects.inputs.scale[moved]
    for actuator in range(len(model.actuator_trntype)):
        settle_actuator(model, data, actuator)
    state = np.empty(mujoco.mj_stateSize(model, spec))
    mujoco.mj_getState(model, data, state, spec)
    return state


def has_memory(model: mujoco.MjModel, actuator: int) -> bool:
    """Whether an actuator remembers controls: a delay line, a setpoint that slews, a filter, an integrator."""
    return bool(model.actuator_history[actuator, 0] or model.actuator_actnum[actuator])


def settle_actuator(model: mujoco.MjModel, data: mujoco.MjData, actuator: int) -> None:
    """Fill an actuator's memories (delay line, setpoint that slews, filter) as a long held control leaves them."""
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
        mujoco.mj_fwdPosition(model, data)  # which knows the actuator's length: at rest the setpoint is there
        length = data.actuator_length[model.actuator_outadr[actuator]]
        feedback = -model.actuator_biasprm[actuator, 1] / model.actuator_gainprm[actuator, 0]
        data.act[model.actuator_actadr[actuator]] = feedback * length


def integrators(model: mujoco.MjModel, layout: Layout) -> np.ndarray:
    """Return the indices in `act` of the setpoints whose speed is what joints are commanded."""
    driving = np.isin(model.actuator_ctrladr, layout.control) & (model.actuator_ctrlnum > 0)
    moving = model.actuator_dyntype == int(mujoco.mjtDyn.mjDYN_INTEGRATOR)
    return np.asarray(model.actuator_actadr[driving & moving], dtype=int)
