"""Stiffness of the stops of a joint's range."""

import math

import mujoco


def compute_stop_stiffness(model: mujoco.MjModel, joint: int) -> float:
    """Return the stiffness of a joint's stops [N·m/rad]; infinite if they are rigid."""
    if model.jnt_solref[joint, 0] >= 0:
        return math.inf
    weight = float(model.dof_invweight0[model.jnt_dofadr[joint]])
    return -float(model.jnt_solref[joint, 0]) / ((1 - float(model.jnt_solimp[joint, 0])) * weight)
