"""Objects in the scene: joints that do not belong to the measured arm, such as a puck or an opponent."""

import contextlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TypeAlias

import mujoco
import numpy as np

from nas_data.dataset.features import POSITION, VELOCITY, Feature
from nas_data.errors import NasError
from nas_data.simulators.controls import Controls, find_command

Units: TypeAlias = Mapping[mujoco.mjtJoint, Mapping[str, str]]  # unit of each component, by type of joint

POSITION_UNITS: Units = {
    mujoco.mjtJoint.mjJNT_HINGE: {"": "rad"},
    mujoco.mjtJoint.mjJNT_SLIDE: {"": "m"},
    mujoco.mjtJoint.mjJNT_BALL: {"qw": "", "qx": "", "qy": "", "qz": ""},
    mujoco.mjtJoint.mjJNT_FREE: {"x": "m", "y": "m", "z": "m", "qw": "", "qx": "", "qy": "", "qz": ""},
}
VELOCITY_UNITS: Units = {
    mujoco.mjtJoint.mjJNT_HINGE: {"": "rad/s"},
    mujoco.mjtJoint.mjJNT_SLIDE: {"": "m/s"},
    mujoco.mjtJoint.mjJNT_BALL: {"wx": "rad/s", "wy": "rad/s", "wz": "rad/s"},
    mujoco.mjtJoint.mjJNT_FREE: {"x": "m/s", "y": "m/s", "z": "m/s", "wx": "rad/s", "wy": "rad/s", "wz": "rad/s"},
}


@dataclass(frozen=True)
class Objects:
    """Joints in kinematic trees that contain no measured joint and that no servo of a measured joint moves.

    The state has m components, positions then velocities: [m, m/s] for a slide, [rad, rad/s] for a hinge, and position
    [m], quaternion, velocity [m/s] and angular velocity [rad/s] for a free joint.

    Attributes:
        feature: Names and units of the m components, for example `puck_x.pos`.
        qpos: Indices of the positions in `qpos`.
        dof: Indices of the velocities in `qvel`.
        servos: Indices, among the positions, of joints with position actuators (an opponent's joints), shape (k,).
        inputs: Command conversions of these k joints.
    """

    feature: Feature
    qpos: np.ndarray
    dof: np.ndarray
    servos: np.ndarray
    inputs: Controls

    @classmethod
    def of(cls, model: mujoco.MjModel, joints: np.ndarray, actuators: np.ndarray, data: mujoco.MjData) -> "Objects":
        """Find the objects of a model.

        Args:
            model: Compiled model.
            joints: Indices of the measured joints.
            actuators: Indices of the actuators that drive them.
            data: Data at the reference posture after forward kinematics.
        """
        arm = {int(model.body_treeid[model.jnt_bodyid[joint]]) for joint in joints} | find_trees(model, actuators, data)
        others = [j for j in range(model.njnt) if int(model.body_treeid[model.jnt_bodyid[j]]) not in arm]
        positions, velocities = (
            [each for joint in others for each in list_components(model, joint, units, suffix, addresses)]
            for units, suffix, addresses in (
                (POSITION_UNITS, POSITION, model.jnt_qposadr),
                (VELOCITY_UNITS, VELOCITY, model.jnt_dofadr),
            )
        )
        qpos = np.array([index for _, _, index in positions], dtype=int)
        servos = list(find_servos(model, others))
        driven = model.jnt_qposadr[servos]
        return cls(
            feature=Feature(
                names=tuple(name for name, _, _ in (*positions, *velocities)),
                units=tuple(unit for _, unit, _ in (*positions, *velocities)),
            ),
            qpos=qpos,
            dof=np.array([index for _, _, index in velocities], dtype=int),
            servos=np.array([int(np.flatnonzero(qpos == address)[0]) for address in driven], dtype=int),
            inputs=Controls.of(model, servos, "the scene"),
        )

    @property
    def control(self) -> np.ndarray:
        """Index of each servo's actuator in `ctrl`, shape (k,)."""
        return self.inputs.index

    @property
    def width(self) -> int:
        """Number of components, m."""
        return self.feature.width

    def measure(self, qpos: np.ndarray, qvel: np.ndarray) -> np.ndarray:
        """Return the objects' states (…, m) from qpos (…, nq) and qvel (…, nv)."""
        return np.concatenate([qpos[..., self.qpos], qvel[..., self.dof]], axis=-1)


def find_trees(model: mujoco.MjModel, actuators: np.ndarray, data: mujoco.MjData) -> set[int]:
    """Return the kinematic trees in which actuators, by index, move a joint in the posture of `data`."""
    rows = zip(data.moment_rowadr[actuators], data.moment_rownnz[actuators], strict=True)
    return {int(model.dof_treeid[dof]) for first, count in rows for dof in data.moment_colind[first : first + count]}


def list_components(
    model: mujoco.MjModel, joint: int, units: Units, suffix: str, addresses: np.ndarray
) -> list[tuple[str, str, int]]:
    """Return name, unit and index of each component of a joint's position or velocity.

    Args:
        model: Compiled model.
        joint: Index of the joint.
        units: `POSITION_UNITS` or `VELOCITY_UNITS`.
        suffix: `.pos` or `.vel`.
        addresses: Index of each joint's first component, shape (njnt,).
    """
    name, first = model.joint(joint).name or f"joint{joint}", int(addresses[joint])
    components = units[mujoco.mjtJoint(model.jnt_type[joint])]
    return [
        (f"{name}.{part}{suffix}" if part else name + suffix, unit, first + i)
        for i, (part, unit) in enumerate(components.items())
    ]


def find_servos(model: mujoco.MjModel, joints: list[int]) -> Iterator[int]:
    """Yield the joints that are commanded positions."""
    for joint in joints:
        with contextlib.suppress(NasError):
            if find_command(model, joint, "the scene")[1].kind == POSITION:
                yield joint
