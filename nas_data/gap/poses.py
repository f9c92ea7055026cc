"""The arm of a model in measured poses."""

from collections.abc import Iterator

import mujoco
import numpy as np

from nas_data.simulators.mujoco import MujocoSimulator
from nas_data.simulators.poses import complete_poses

POSES = 2_000  # most poses of a recording in which shapes are compared


def pose_arm(simulator: MujocoSimulator, poses: np.ndarray) -> Iterator[mujoco.MjData]:
    """Yield the model's data in each pose (N, n), followers placed, after `mj_kinematics`; the data are reused."""
    model, layout, data = simulator.model, simulator.layout, mujoco.MjData(simulator.model)
    for qpos in complete_poses(model, layout.qpos, layout.followers, poses):
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        yield data
