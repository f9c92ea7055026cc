"""What moves in a model beside the measured arm: pushed things, and what other actuators drive."""

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np

from nas_data.dataset.features import POSITION, VELOCITY, Feature
from nas_data.errors import NasError
from nas_data.simulators.controls import Controls, find_command

FREE = ("x", "y", "z", "qw", "qx", "qy", "qz"), ("x", "y", "z", "wx", "wy", "wz")  # components of a free joint
BALL = ("qw", "qx", "qy", "qz"), ("wx", "wy", "wz")
LENGTHS = {"x": "m", "y": "m", "z": "m"}


@dataclass(frozen=True)
class Objects:
    """Joints in the kinematic trees that neither hold a measured joint nor are moved by one's servo.

    Their state is positions, then velocities: a slide's [m, m/s], a hinge's [rad, rad/s], a free joint's place [m],
    quaternion, velocity [m/s] and rate [rad/s]; m numbers in all.

    Attributes:
        feature: Names and units of the m components, for example `puck_x.pos`.
        qpos: Their indices in `qpos`.
        dof: Their indices in `qvel`.
        servos: Places among the positions of what position actuators drive (an opponent's joints), shape (k,).
        inputs: The controls of those actuators, k of them.
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
            data: At the reference posture, forward kinematics done.
        """
        moved = {int(model.body_treeid[model.jnt_bodyid[joint]]) for joint in joints} | trees_of(model, actuators, data)
        others = [j for j in range(model.njnt) if int(model.body_treeid[model.jnt_bodyid[j]]) not in moved]
        labels = [component for joint in others for component in positions_of(model, joint)]
        speeds = [component for joint in others for component in velocities_of(model, joint)]
        qpos = np.array([index for _, _, index in labels], dtype=int)
        servos = list(servos_of(model, others))
        driven = model.jnt_qposadr[servos]
        return cls(
            feature=Feature(
                names=tuple(name for name, _, _ in (*labels, *speeds)),
                units=tuple(unit for _, unit, _ in (*labels, *speeds)),
            ),
            qpos=qpos,
            dof=np.array([index for _, _, index in speeds], dtype=int),
            servos=np.array([int(np.flatnonzero(qpos == address)[0]) for address in driven], dtype=int),
            inputs=Controls.of(model, servos, "the scene"),
        )

    @property
    def control(self) -> np.ndarray:
        """Index of each of the servos' actuators in `ctrl`, shape (k,)."""
        return self.inputs.index

    @property
    def width(self) -> int:
        """Number of components, m."""
        return self.feature.width

    def measure(self, qpos: np.ndarray, qvel: np.ndarray) -> np.ndarray:
        """Return the objects' states (…, m) from qpos (…, nq) and qvel (…, nv)."""
        return np.concatenate([qpos[..., self.qpos], qvel[..., self.dof]], axis=-1)


def trees_of(model: mujoco.MjModel, actuators: np.ndarray, data: mujoco.MjData) -> set[int]:
    """Return the kinematic trees in which some actuators move a joint in the posture of `data`."""
    rows = zip(data.moment_rowadr[actuators], data.moment_rownnz[actuators], strict=True)
    return {int(model.dof_treeid[dof]) for first, count in rows for dof in data.moment_colind[first : first + count]}


def positions_of(model: mujoco.MjModel, joint: int) -> list[tuple[str, str, int]]:
    """Return name, unit and index in `qpos` of each component of a joint's position."""
    name, first = model.joint(joint).name or f"joint{joint}", int(model.jnt_qposadr[joint])
    kind = mujoco.mjtJoint(model.jnt_type[joint])
    if kind in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE):
        return [(name + POSITION, "rad" if kind == mujoco.mjtJoint.mjJNT_HINGE else "m", first)]
    parts = (FREE if kind == mujoco.mjtJoint.mjJNT_FREE else BALL)[0]
    return [(f"{name}.{part}{POSITION}", LENGTHS.get(part, ""), first + i) for i, part in enumerate(parts)]


def velocities_of(model: mujoco.MjModel, joint: int) -> list[tuple[str, str, int]]:
    """Return name, unit and index in `qvel` of each component of a joint's velocity."""
    name, first = model.joint(joint).name or f"joint{joint}", int(model.jnt_dofadr[joint])
    kind = mujoco.mjtJoint(model.jnt_type[joint])
    if kind in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE):
        return [(name + VELOCITY, "rad/s" if kind == mujoco.mjtJoint.mjJNT_HINGE else "m/s", first)]
    parts = (FREE if kind == mujoco.mjtJoint.mjJNT_FREE else BALL)[1]
    units = ["m/s" if part in LENGTHS else "rad/s" for part in parts]
    return [(f"{name}.{part}{VELOCITY}", units[i], first + i) for i, part in enumerate(parts)]


def servos_of(model: mujoco.MjModel, joints: list[int]) -> Iterator[int]:
    """Yield each joint that is commanded positions."""
    for joint in joints:
        with contextlib.suppress(NasError):
            if find_command(model, joint, "the scene")[1].kind == POSITION:
                yield joint
