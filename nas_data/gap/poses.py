"""The arm of a model in measured poses."""

from collections.abc import Iterator

import mujoco
import numpy as np

from nas_data.simulators.mujoco import MujocoSimulator

POSES = 2_000  # most poses of a recording in which shapes are compared


def pose_arm(simulator: MujocoSimulator, poses: np.ndarray) -> Iterator[mujoco.MjData]:
    """Yield the model's data in each pose (N, n), followers placed, after `mj_kinematics`; the data are reused."""
    model, layout, data = simulator.model, simulator.layout, mujoco.MjData(simulator.model)
    for pose in poses:
        data.qpos[layout.qpos] = pose
        if layout.followers is not None:
            layout.followers.place(data.qpos[None], data.qvel[None])
        mujoco.mj_kinematics(model, data)
        yield data
