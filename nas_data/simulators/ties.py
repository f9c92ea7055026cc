"""Joints that an equality constraint holds, or lets follow another joint in proportion."""

from dataclasses import dataclass

import mujoco
import numpy as np

POLYNOMIAL = 5  # coefficients by which a joint follows another, the constant first


@dataclass(frozen=True)
class Tie:
    """A joint that a constraint puts at ratio · leader + offset, both counted from their references.

    Attributes:
        joint: Index of the joint.
        leader: Index of the joint that it follows; None where it is held.
        ratio: How far it moves when its leader moves by one.
        offset: Where it is when its leader is at its reference [rad; m].
    """

    joint: int
    leader: int | None
    ratio: float
    offset: float


def active_equalities(model: mujoco.MjModel) -> np.ndarray:
    """Return the indices of the equality constraints that act."""
    if model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_EQUALITY):
        return np.empty(0, int)
    return np.flatnonzero(model.eq_active0)


def find_ties(model: mujoco.MjModel) -> list[Tie]:
    """Return the ties that acting constraints make; other constraints (loops, tendons, curves) are left out."""
    found = []
    for index in active_equalities(model).tolist():
        offset, ratio, *curve = model.eq_data[index, :POLYNOMIAL].tolist()
        if int(model.eq_type[index]) != int(mujoco.mjtEq.mjEQ_JOINT):
            continue
        joint, leader = int(model.eq_obj1id[index]), int(model.eq_obj2id[index])
        if leader < 0:
            found.append(Tie(joint, None, 0.0, offset))
        elif not any(curve):
            found.append(Tie(joint, leader, ratio, offset))
    return found
