"""All positions of a model whose measured joints are given."""

import mujoco
import numpy as np

from nas_data.simulators.followers import Followers


def complete_poses(
    model: mujoco.MjModel, measured: np.ndarray, followers: Followers | None, poses: np.ndarray
) -> np.ndarray:
    """Return all positions in poses of the measured joints, shape (N, nq).

    Followers are placed where constraints hold them; all other joints are at their reference.

    Args:
        model: Compiled model.
        measured: Index of each measured joint in `qpos`, shape (n,).
        followers: Joints that constraints tie to the measured ones; None if there are none.
        poses: Positions of the measured joints [rad; m], shape (N, n).
    """
    qpos = np.tile(model.qpos0, (len(poses), 1))
    qpos[:, measured] = poses
    if followers is not None and len(poses):
        # a pose does not depend on the one before it: each starts at the reference
        followers.place(qpos, np.zeros((len(poses), model.nv)), from_reference=True)
    return qpos
