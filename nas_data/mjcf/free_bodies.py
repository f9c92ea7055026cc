"""Bodies that free joints move, such as objects in a scene."""

import mujoco
import numpy as np


def find_free_bodies(model: mujoco.MjModel) -> np.ndarray:
    """Return which bodies a free or ball joint moves, such as objects, shape (nbody,)."""
    kinds = (mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtJoint.mjJNT_BALL)
    free = np.zeros(model.nbody, bool)
    free[model.jnt_bodyid[np.isin(model.jnt_type, [int(kind) for kind in kinds])]] = True
    for body in range(1, model.nbody):  # parents have lower indices
        free[body] |= free[model.body_parentid[body]]
    return free
