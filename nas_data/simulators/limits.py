"""Within what limits a model's joints may be commanded."""

from collections.abc import Sequence

import mujoco
import numpy as np

from nas_data.errors import OptionError
from nas_data.simulators.layout import actuator_index, joint_index, takes_effort

UNLIMITED = np.pi / 2  # [rad] how far a signal turns a joint for which the model has no limits


def command_limits(model: mujoco.MjModel, joints: Sequence[str], name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest and highest command of each joint.

    A position is limited by the actuator's control range and the joint's range, a torque by the control range alone.

    Args:
        model: Compiled model.
        joints: Commanded joints.
        name: What to call the model in an error.

    Returns:
        Lower and upper limits [rad or N·m], shape (n,) each; infinite where the model has none.

    Raises:
        JointMismatch: the model lacks a joint, or nothing drives it.
    """
    low, high = np.full(len(joints), -np.inf), np.full(len(joints), np.inf)
    for row, joint in enumerate(joints):
        index = joint_index(model, joint, name)
        actuator = actuator_index(model, index, name)
        ranges = []
        if model.actuator_ctrllimited[actuator]:
            ranges.append(model.actuator_ctrlrange[actuator])
        if model.jnt_limited[index] and not takes_effort(model, actuator):
            ranges.append(model.jnt_range[index])
        for lower, upper in ranges:
            low[row], high[row] = max(low[row], lower), min(high[row], upper)
    return low, high


def excitable_limits(
    low: np.ndarray, high: np.ndarray, joints: Sequence[str], effort: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Return finite limits for a command signal; a joint that turns without end gets a quarter turn each way.

    Args:
        low: Lowest commands [rad or N·m], shape (n,), possibly infinite.
        high: Highest commands, shape (n,).
        joints: Their names.
        effort: Whether commands are torques, for which nothing can be assumed.

    Raises:
        OptionError: a torque has no limits.
    """
    unbounded = [joint for joint, span in zip(joints, high - low, strict=True) if not np.isfinite(span)]
    if unbounded and effort:
        raise OptionError(
            f"The torque of {', '.join(unbounded)} has no limits; give their actuators a ctrlrange, "
            "or play a file of commands (--commands)."
        )
    return np.where(np.isfinite(low), low, np.minimum(-UNLIMITED, high)), np.where(
        np.isfinite(high), high, np.maximum(UNLIMITED, low)
    )
