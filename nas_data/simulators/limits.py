"""Limits of the joints' commands in a model."""

from collections.abc import Collection, Sequence

import mujoco
import numpy as np

from nas_data.dataset.features import EFFORT, POSITION
from nas_data.errors import OptionError
from nas_data.joint_units import compute_angle_scales
from nas_data.robots.base import Robot
from nas_data.simulators.base import Simulator
from nas_data.simulators.controls import command_range, find_command
from nas_data.simulators.layout import find_joint_index

UNLIMITED = np.pi / 2  # [rad] limit of a command signal for a hinge without limits in the model


def command_limits(model: mujoco.MjModel, joints: Sequence[str], name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest and highest command of each joint.

    The actuator's control range limits all commands; the joint's range limits positions, too.

    Args:
        model: Compiled model.
        joints: Commanded joints.
        name: Name of the model in errors.

    Returns:
        Lower and upper limits in the units of the commands, shape (n,) each; infinite without a limit.

    Raises:
        JointMismatch: the model lacks a joint, or no actuator drives it.
    """
    low, high = np.full(len(joints), -np.inf), np.full(len(joints), np.inf)
    for row, joint in enumerate(joints):
        index = find_joint_index(model, joint, name)
        actuator, control = find_command(model, index, name)
        ranges = [command_range(model, actuator, control)]
        if model.jnt_limited[index] and control.kind == POSITION:
            ranges.append(tuple(model.jnt_range[index]))
        for lower, upper in ranges:
            low[row], high[row] = max(low[row], lower), min(high[row], upper)
    return low, high


def position_limits(model: mujoco.MjModel, joints: Sequence[str], name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest and highest position of each joint that its range and its commands allow.

    Args:
        model: Compiled model.
        joints: Commanded joints.
        name: Name of the model in errors.

    Returns:
        Lower and upper limits [rad; m], shape (n,) each; infinite without a limit.

    Raises:
        JointMismatch: the model lacks a joint, or no actuator drives it.
    """
    low, high = command_limits(model, joints, name)
    for row, joint in enumerate(joints):
        index = find_joint_index(model, joint, name)
        if find_command(model, index, name)[1].kind != POSITION:
            low[row], high[row] = model.jnt_range[index] if model.jnt_limited[index] else (-np.inf, np.inf)
    return low, high


def find_rest_pose(robot: Robot, model: mujoco.MjModel) -> np.ndarray:
    """Return a robot's rest pose, else the pose closest to zero within the ranges [rad; m], shape (n,)."""
    if robot.rest:
        return np.array(robot.rest)
    return np.clip(np.zeros(len(robot.joints)), *position_limits(model, robot.joints, str(robot.mjcf)))


def command_radians(simulator: Simulator, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return the equivalent of a radian in each joint's command, shape (n,): range / π for a slide's position, else 1.

    Args:
        simulator: Simulator of the arm.
        low: Lowest commands, finite, shape (n,).
        high: Highest commands, finite, shape (n,).
    """
    kinds = zip(simulator.joints, simulator.kinds, strict=True)
    slides = [joint for joint, kind in kinds if kind == POSITION and joint in simulator.slides]
    return compute_angle_scales(simulator.joints, slides, high - low)


def find_excitable_limits(
    low: np.ndarray, high: np.ndarray, joints: Sequence[str], kinds: Sequence[str], slides: Collection[str] = ()
) -> tuple[np.ndarray, np.ndarray]:
    """Return finite limits for a command signal; a hinge without limits gets a quarter turn in each direction.

    Args:
        low: Lowest commands, possibly infinite, shape (n,).
        high: Highest commands, possibly infinite, shape (n,).
        joints: Names of the joints.
        kinds: Command quantity of each joint.
        slides: Names of the joints that are slides.

    Raises:
        OptionError: a torque, a velocity or a slide's position has no limits.
    """
    for joint, kind, span in zip(joints, kinds, high - low, strict=True):
        if not np.isfinite(span) and kind != POSITION:
            quantity = "speed" if kind != EFFORT else "force" if joint in slides else "torque"
            raise OptionError(
                f"The {quantity} of {joint} has no limits; give its actuator a "
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
