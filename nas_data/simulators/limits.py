"""Within what limits a model's joints may be commanded."""

from collections.abc import Collection, Sequence

import mujoco
import numpy as np

from nas_data.dataset.features import EFFORT, POSITION
from nas_data.errors import OptionError
from nas_data.joint_units import radians_at
from nas_data.simulators.base import Simulator
from nas_data.simulators.controls import control_range, find_command
from nas_data.simulators.layout import joint_index

UNLIMITED = np.pi / 2  # [rad] how far a signal turns a joint for which the model has no limits


def command_limits(model: mujoco.MjModel, joints: Sequence[str], name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest and highest command of each joint.

    A position is limited by the actuator's control range and the joint's range, anything else by the former alone.

    Args:
        model: Compiled model.
        joints: Commanded joints.
        name: What to call the model in an error.

    Returns:
        Lower and upper limits, in the units of the commands, shape (n,) each; infinite where the model has none.

    Raises:
        JointMismatch: the model lacks a joint, or nothing drives it.
    """
    low, high = np.full(len(joints), -np.inf), np.full(len(joints), np.inf)
    for row, joint in enumerate(joints):
        index = joint_index(model, joint, name)
        actuator, control = find_command(model, index, name)
        ranges = [control_range(model, actuator, control)]
        if model.jnt_limited[index] and control.kind == POSITION:
            ranges.append(tuple(model.jnt_range[index]))
        for lower, upper in ranges:
            low[row], high[row] = max(low[row], lower), min(high[row], upper)
    return low, high


def command_radians(simulator: Simulator, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return what stands for a radian in the commands of each joint, shape (n,): of a commanded slide its range over π.

    Args:
        simulator: The arm.
        low: Lowest commands, shape (n,), finite.
        high: Highest commands, shape (n,).
    """
    kinds = zip(simulator.joints, simulator.kinds, strict=True)
    placed = [joint for joint, kind in kinds if kind == POSITION and joint in simulator.slides]
    return radians_at(simulator.joints, placed, high - low)


def excitable_limits(
    low: np.ndarray, high: np.ndarray, joints: Sequence[str], kinds: Sequence[str], slides: Collection[str] = ()
) -> tuple[np.ndarray, np.ndarray]:
    """Return finite limits for a command signal; a joint that turns without end gets a quarter turn each way.

    Args:
        low: Lowest commands, shape (n,), possibly infinite.
        high: Highest commands, shape (n,).
        joints: Their names.
        kinds: What is commanded; of torques and speeds nothing can be assumed.
        slides: Joints that are slides, of whose range nothing can be assumed either.

    Raises:
        OptionError: a torque, a speed or a slide has no limits.
    """
    for joint, kind, span in zip(joints, kinds, high - low, strict=True):
        if not np.isfinite(span) and kind != POSITION:
            raise OptionError(
                f"The {'torque' if kind == EFFORT else 'speed'} of {joint} has no limits; give its actuator a "
                "ctrlrange, or play a file of commands (--commands)."
            )
        if not np.isfinite(span) and joint in slides:
            raise OptionError(
                f"The slide {joint} has no range; give its joint one in the model (range=), or play a file of commands "
                "(--commands)."
            )
    return np.where(np.isfinite(low), low, np.minimum(-UNLIMITED, high)), np.where(
        np.isfinite(high), high, np.maximum(UNLIMITED, low)
    )
