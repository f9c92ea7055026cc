"""Indices and linear maps of the measured joints in a compiled MuJoCo model."""

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from nas_data.dataset.features import POSITION
from nas_data.errors import JointMismatch, ModelFileError
from nas_data.simulators.controls import Controls, UnknownControl, find_command, find_length_control
from nas_data.simulators.followers import Followers
from nas_data.simulators.objects import Objects
from nas_data.simulators.other_actuators import warn_of_held_actuators

FULLPHYSICS = int(mujoco.mjtState.mjSTATE_FULLPHYSICS)
INTEGRATION = int(mujoco.mjtState.mjSTATE_INTEGRATION)


@dataclass(frozen=True)
class Layout:
    """Indices and linear maps of n measured joints in a model with nq positions, nv speeds and nu controls.

    Attributes:
        joints: Names of the measured joints.
        qpos: Index of each joint in `qpos`, shape (n,).
        dof: Index of each joint in `qvel`, shape (n,).
        inputs: Quantity that each joint is commanded, and the conversion to its control.
        position_map: Measured positions = position_map @ qpos, shape (n, nq). A row has more than one entry if play
            or compliance adds to the servo's angle.
        velocity_map: Measured velocities = velocity_map @ qvel, shape (n, nv).
        reference: Controls that hold the model at its reference posture, shape (nu,).
        followers: Joints that constraints tie to the measured ones; None if there are none.
        objects: Joints of objects in the scene.
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
            name: Name of the model in errors.

        Raises:
            JointMismatch: the model lacks a joint, or no actuator drives it.
            ModelFileError: the command quantity of an actuator is unknown.
        """
        indices = np.array([find_joint_index(model, joint, name) for joint in joints], dtype=int)
        inputs = Controls.of(model, indices, name)
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        positions, velocities = build_measurement_maps(model, joints, indices, name)
        dof = model.jnt_dofadr[indices].astype(int)
        followers = Followers.of(model, np.union1d(dof, np.flatnonzero(velocities.any(axis=0))))
        driven = indices if followers is None else np.concatenate([indices, followers.joints])
        warn_of_held_actuators(model, indices.tolist(), inputs.actuators.tolist(), name)
        return cls(
            joints=tuple(joints),
            qpos=model.jnt_qposadr[indices].astype(int),
            dof=dof,
            inputs=inputs,
            position_map=positions,
            velocity_map=velocities,
            reference=compute_reference_controls(model, data),
            followers=followers,
            objects=Objects.of(model, driven, inputs.actuators, data),
        )

    @property
    def control(self) -> np.ndarray:
        """Index of each joint's actuator in `ctrl`, shape (n,)."""
        return self.inputs.index

    @property
    def kinds(self) -> tuple[str, ...]:
        """Command quantity of each joint: `.pos`, `.vel` or `.effort`."""
        return self.inputs.kinds

    def measure(self, qpos: np.ndarray, qvel: np.ndarray) -> np.ndarray:
        """Return positions [rad] then velocities [rad/s], shape (…, 2n), from qpos (…, nq) and qvel (…, nv)."""
        return np.concatenate([qpos @ self.position_map.T, qvel @ self.velocity_map.T], axis=-1)

    def controls(self, commands: np.ndarray, first: np.ndarray | None = None) -> np.ndarray:
        """Return controls (…, nu) for commands (…, n); other actuators hold their reference position.

        Args:
            commands: Commands in the quantities of `kinds`, shape (…, n).
            first: Initial states, shape (…, 2n or 2n + m). If they include objects, servos of objects hold the
                given positions.
        """
        controls = np.empty((*commands.shape[:-1], len(self.reference)))
        controls[...] = self.reference
        controls[..., self.control] = self.inputs.from_commands(commands)
        if first is not None and first.shape[-1] > 2 * len(self.joints) and len(self.objects.control):
            held = first[..., 2 * len(self.joints) + self.objects.servos]
            controls[..., self.objects.control] = self.objects.inputs.from_commands(held)
        return controls


def find_joint_index(model: mujoco.MjModel, joint: str, name: str) -> int:
    """Return the index of a hinge or slide joint by its name.

    Raises:
        JointMismatch: the model has no such joint, or it is a ball or free joint.
    """
    index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, joint)
    if index < 0:
        names = ", ".join(filter(None, (model.joint(i).name for i in range(model.njnt))))
        raise JointMismatch(
            f"{name} has no joint '{joint}'; it has: {names}. Joints are matched by name; use one name for both."
        )
    if mujoco.mjtJoint(model.jnt_type[index]) not in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE):
        raise JointMismatch(
            f"The joint '{joint}' of {name} is neither hinge nor slide; only those are measured: leave it out."
        )
    return index


def find_actuator_index(model: mujoco.MjModel, joint: int, name: str) -> int:
    """Return the index of the actuator that commands a joint; errors as of `find_command`."""
    return find_command(model, joint, name)[0]


def build_measurement_maps(
    model: mujoco.MjModel, joints: Sequence[str], indices: np.ndarray, name: str
) -> tuple[np.ndarray, np.ndarray]:
    """Return the maps from qpos and qvel to the measured state, shapes (n, nq) and (n, nv).

    A sensor `<joint>.pos` defines the measurement: the position of a joint, or the length of a fixed tendon (servo
    angle plus play). Without a sensor the joint itself is measured.
    """
    positions = np.zeros((len(joints), model.nq))
    velocities = np.zeros((len(joints), model.nv))
    for row, (joint, index) in enumerate(zip(joints, indices, strict=True)):
        for member, share in find_measured_joints(model, joint, int(index), name):
            positions[row, model.jnt_qposadr[member]] += share
            velocities[row, model.jnt_dofadr[member]] += share
    return positions, velocities


def find_measured_joints(model: mujoco.MjModel, joint: str, index: int, name: str) -> list[tuple[int, float]]:
    """Return the joints and weights whose weighted sum is measured under a joint's name.

    Raises:
        ModelFileError: the sensor `<joint>.pos` is of another type.
    """
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
    raise ModelFileError(
        f"The sensor '{joint}{POSITION}' of {name} is not the position of a joint or of a fixed tendon; use <jointpos> "
        "or <tendonpos>, or remove it."
    )


def compute_reference_controls(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """Return controls (nu,) that hold position actuators at the reference posture; the others are zero.

    Args:
        model: Compiled model.
        data: Data at the reference posture after forward kinematics.
    """
    controls = np.zeros(model.nu)
    for actuator in np.flatnonzero(model.actuator_ctrlnum).tolist():
        with contextlib.suppress(UnknownControl):
            control = find_length_control(model, actuator)
            if control.kind == POSITION:
                length = float(data.actuator_length[model.actuator_outadr[actuator]])
                controls[model.actuator_ctrladr[actuator]] = control.scale * length + control.zero
    return controls
