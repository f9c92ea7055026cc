"""Which poses of a model touch something: itself, the floor, an object."""

import mujoco
import numpy as np

from nas_data.simulators.mujoco import MujocoSimulator


def contact_counts(simulator: MujocoSimulator, positions: np.ndarray) -> np.ndarray:
    """Return how many contacts the model has in poses [rad], shape (N, n): shape (N,)."""
    data = mujoco.MjData(simulator.model)
    counts = np.empty(len(positions), int)
    for row, pose in enumerate(positions):
        data.qpos[simulator.layout.qpos] = pose
        mujoco.mj_kinematics(simulator.model, data)
        mujoco.mj_comPos(simulator.model, data)
        mujoco.mj_collision(simulator.model, data)
        counts[row] = data.ncon
    return counts
