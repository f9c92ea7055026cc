"""A soft constraint that pulls a joint towards a constant: what the paper's authors simulated as backlash."""

import mujoco
import numpy as np

TOWARDS = 3.0  # [rad] beyond the joints' limits, the first coefficient of the authors' constraint


def pull_joint(spec: mujoco.MjSpec, joint: str, width: float) -> None:
    """Add the authors' constraint to a joint: there is no play in it.

    Their impedance is 0.01 at the goal and asks for more than 1 at a distance of `width`; the engine clamps that to
    0.9999, so that only the width matters.

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
