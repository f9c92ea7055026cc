"""A soft constraint that pulls a joint towards a constant: the paper's simulation of backlash."""

import mujoco
import numpy as np

TOWARDS = 3.0  # [rad] beyond the joints' limits, the first coefficient of the authors' constraint


def pull_joint(spec: mujoco.MjSpec, joint: str, width: float) -> None:
    """Add the authors' constraint to a joint; it contains no actual play.

    Its impedance is 0.01 at the goal and above 1 at a distance of `width`. The engine clamps the latter to 0.9999, so
    only the width matters.

    Args:
        spec: Model.
        joint: Joint's name.
        width: Distance [rad] over which the impedance rises.
    """
    constraint = spec.add_equality(
        name=f"{joint}_pull", type=mujoco.mjtEq.mjEQ_JOINT, objtype=mujoco.mjtObj.mjOBJ_JOINT, name1=joint
    )
    data = np.zeros_like(constraint.data)
    data[0] = TOWARDS
    constraint.data = data
    constraint.solimp = [0.01, 1.0, width, 0.5, 2.0]
