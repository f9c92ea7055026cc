"""Stops of a joint's range that yield, for an engine that has rigid ones only."""

import mujoco
import numpy as np

from nas_data.mjcf.stop_stiffness import compute_stop_stiffness

RESOLVED = 0.5  # impedance below which the timestep resolves the oscillation on a stop


class YieldingStops:
    """Stops as springs, for an engine that has rigid ones only; stops too stiff for the timestep are left to it."""

    def __init__(self, model: mujoco.MjModel) -> None:
        """Find the stops of a compiled model."""
        self.joints = find_yielding_stops(model)
        self.qpos, self.dof = model.jnt_qposadr[self.joints], model.jnt_dofadr[self.joints]
        self.low, self.high = model.jnt_range[self.joints].T
        self.stiffness = np.array([compute_stop_stiffness(model, joint) for joint in self.joints])
        stiffness, damping = model.jnt_solref[self.joints].T
        self.loss_time = damping / stiffness

    def compute_torques(self, qpos: np.ndarray, qvel: np.ndarray) -> np.ndarray:
        """Return the torques of the stops [N·m; N], shape (nv,), for qpos (nq,) and qvel (nv,)."""
        torques, positions = np.zeros(len(qvel)), qpos[self.qpos]
        beyond = positions - np.clip(positions, self.low, self.high)
        side = np.sign(beyond)
        push = side * self.stiffness * (beyond + self.loss_time * qvel[self.dof])
        torques[self.dof] = -side * np.maximum(push, 0)  # a stop never pulls
        return torques


def find_yielding_stops(model: mujoco.MjModel) -> list[int]:
    """Return the joints whose stops yield and are soft enough for the timestep."""
    soft = model.jnt_limited.astype(bool) & (model.jnt_solref[:, 0] < 0) & (model.jnt_solimp[:, 0] < RESOLVED)
    return [int(joint) for joint in np.flatnonzero(soft)]
