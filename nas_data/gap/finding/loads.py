"""The model's torques in measured states: load of the posture, and saturation of the servo."""

from dataclasses import dataclass

import mujoco
import numpy as np

from nas_data.gap.finding.recorded import RecordedRows
from nas_data.gap.nominal import Nominal
from nas_data.simulators.layout import FULLPHYSICS, find_actuator_index, find_joint_index
from nas_data.simulators.mujoco import MujocoSimulator

AT_LIMIT = 1 - 1e-6  # share of the limit above which a servo is saturated


@dataclass(frozen=True)
class Loads:
    """Torques of n joints in E episodes of up to T rows."""

    posture: np.ndarray  # gravity and Coriolis torque of each joint [N·m; N], shape (E, T, n)
    saturated: np.ndarray  # whether the model's actuator is at its limit, shape (E, T, n)
    limited: np.ndarray  # whether a joint's actuator has a limit, shape (n,)


def find_loads(nominal: Nominal, recorded: RecordedRows) -> Loads:
    """Evaluate the model in every measured state, with the command given there."""
    simulator = nominal.simulator()
    simulator.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    counts = recorded.evidence.mask
    states = np.concatenate([recorded.positions, recorded.motion], axis=-1)[counts]
    posture, force = compute_torques(simulator, states, recorded.evidence.commands[counts])
    low, high = read_torque_limits(simulator)
    saturated = (force <= low * AT_LIMIT) | (force >= high * AT_LIMIT)
    return Loads(scatter_rows(posture, counts), scatter_rows(saturated, counts), np.isfinite(high))


def scatter_rows(rows: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """Return values of recorded rows (N, n) at their places (E, T, n), 0 elsewhere."""
    result = np.zeros((*counts.shape, rows.shape[1]), rows.dtype)
    result[counts] = rows
    return result


def compute_torques(
    simulator: MujocoSimulator, states: np.ndarray, commands: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return load of the posture and actuator torque [N·m; N] for states and commands, shape (N, n) each."""
    model, layout = simulator.model, simulator.layout
    data = mujoco.MjData(model)
    full, controls = simulator.rest(states), layout.controls(commands)
    load, force = np.zeros_like(commands), np.zeros_like(commands)
    for row in range(len(states)):
        mujoco.mj_setState(model, data, full[row], FULLPHYSICS)
        data.ctrl[:] = controls[row]
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_fwdActuation(model, data)
        load[row] = (data.qfrc_bias - data.qfrc_gravcomp)[layout.dof]
        force[row] = data.qfrc_actuator[layout.dof]
    return load, force


def read_torque_limits(simulator: MujocoSimulator) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest and highest actuator torques at the joints [N·m; N], shape (n,) each."""
    model = simulator.model
    low, high = np.full(len(simulator.joints), -np.inf), np.full(len(simulator.joints), np.inf)
    for row, name in enumerate(simulator.joints):
        joint = find_joint_index(model, name, str(simulator.robot.mjcf))
        actuator = find_actuator_index(model, joint, str(simulator.robot.mjcf))
        ranges = []
        if model.actuator_forcelimited[actuator]:
            ranges.append(np.sort(model.actuator_forcerange[actuator] * model.actuator_gear[actuator, 0]))
        if model.jnt_actfrclimited[joint]:
            ranges.append(model.jnt_actfrcrange[joint])
        for lower, upper in ranges:
            low[row], high[row] = max(low[row], lower), min(high[row], upper)
    return low, high
