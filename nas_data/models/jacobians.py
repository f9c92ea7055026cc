"""Jacobians of a source's next state with respect to state and command, by finite differences."""

import numpy as np

from nas_data.joint_units import compute_angle_scales
from nas_data.simulators.base import Simulator

# For slides the steps are multiplied by the equivalent of a radian, see `joint_units.compute_angle_scales`.
POSITION_STEP = 0.03  # [rad] large enough to average over friction and saturation
VELOCITY_STEP = 0.3  # [rad/s]
COMMAND_STEP = 0.3  # [N·m; N]


def estimate_jacobians(
    simulator: Simulator, states: np.ndarray, commands: np.ndarray, predicted: np.ndarray, of_commands: bool = False
) -> np.ndarray:
    """Estimate the Jacobian of one control step for each transition by one-sided differences.

    Args:
        simulator: Source.
        states: Positions [rad; m] then velocities [rad/s; m/s], shape (N, 2n), or with the objects' (N, 2n + m).
        commands: Shape (N, n).
        predicted: Source's next states, shape (N, 2n).
        of_commands: Whether to append the derivatives with respect to commands.

    Returns:
        Derivatives of next states with respect to states, shape (N, 2n, 2n), or to states and commands, (N, 2n, 3n).
    """
    width = predicted.shape[1]
    travel = np.ptp(states[:, : width // 2], axis=0)
    radians = compute_angle_scales(simulator.joints, simulator.slides, travel)
    steps = np.concatenate([POSITION_STEP * radians, VELOCITY_STEP * radians])
    slopes = np.empty((len(states), width, width))
    for column, step in enumerate(steps):
        moved = states.copy()
        moved[:, column] += step
        slopes[:, :, column] = (simulator.predict(moved, commands)[:, :width] - predicted) / step
    if not of_commands:
        return slopes
    return np.concatenate([slopes, estimate_command_jacobians(simulator, states, commands, predicted)], axis=2)


def estimate_command_jacobians(
    simulator: Simulator, states: np.ndarray, commands: np.ndarray, predicted: np.ndarray
) -> np.ndarray:
    """Return the derivatives of next states with respect to torques, shape (N, 2n, n); see `estimate_jacobians`."""
    slopes = np.empty((*predicted.shape, commands.shape[1]))
    for column in range(commands.shape[1]):
        step = np.where(
            commands[:, column] > 0, -COMMAND_STEP, COMMAND_STEP
        )  # towards zero, away from the torque limits
        moved = commands.copy()
        moved[:, column] += step
        after = simulator.predict(states, moved)[:, : predicted.shape[1]]
        slopes[:, :, column] = (after - predicted) / step[:, None]
    return slopes
