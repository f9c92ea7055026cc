"""Naming by regression: regressors that explain one-step residual accelerations, joint by joint."""

from pathlib import Path

import numpy as np

from nas_data.benchmarks.blind.baselines.base import Claim, RecordedCase, claim
from nas_data.benchmarks.blind.fresh import Delivered, find_actuators
from nas_data.simulators.mujoco import MujocoSimulator

LEAST = 0.02  # share of a residual's variance that a regressor must explain alone to be named
# each regressor's effect, in the order of `compute_regressors`
EFFECTS = ("coulomb_friction", "viscous_friction", "rotor_inertia", "servo_stiffness", "joint_offset", "command_delay")


def answer(dataset: Path, model: Path) -> Claim:
    """Name the regressor that explains the largest share of any joint's residual; the model is not changed."""
    recorded = RecordedCase.load(dataset)
    n = len(recorded.joints)
    simulator = MujocoSimulator.load(model, 1 / recorded.rate, recorded.joints, threads=1)
    states, commands = recorded.states[:, 1:-1], recorded.commands[:, 1:]
    predicted = simulator.predict(states.reshape(-1, 2 * n), commands.reshape(-1, n)).reshape(states.shape)
    residual = (recorded.states[:, 2:] - predicted)[..., n:] * recorded.rate
    shares = np.array(
        [
            compute_explained_shares(compute_regressors(recorded, joint), residual[..., joint].ravel())
            for joint in range(n)
        ]
    )
    joint, effect = np.unravel_index(int(np.argmax(shares)), shares.shape)
    named = (claim(EFFECTS[int(effect)], recorded.joints[int(joint)]),) if shares.max() > LEAST else ()
    plain = Delivered.load(model, recorded.joints, find_actuators(model, recorded.joints), recorded.rate)
    return Claim(named, plain.play)


def compute_regressors(recorded: RecordedCase, joint: int) -> np.ndarray:
    """Return candidate regressors of a joint's residual, shape (6, samples), in the order of `EFFECTS`."""
    n = len(recorded.joints)
    position, speed = recorded.states[:, 1:-1, joint], recorded.states[:, 1:-1, n + joint]
    acceleration = (speed - recorded.states[:, :-2, n + joint]) * recorded.rate
    command, before = recorded.commands[:, 1:, joint], recorded.commands[:, :-1, joint]
    columns = [np.sign(speed), speed, acceleration, command - position, np.ones_like(speed), command - before]
    return np.stack([column.ravel() for column in columns])


def compute_explained_shares(columns: np.ndarray, residual: np.ndarray) -> np.ndarray:
    """Return the share of the residual's mean square that each regressor explains beyond all others, shape (6,)."""
    whole = sum_squared_residuals(columns, residual)
    alone = [sum_squared_residuals(np.delete(columns, row, axis=0), residual) - whole for row in range(len(columns))]
    return np.array(alone) / (residual @ residual)


def sum_squared_residuals(columns: np.ndarray, residual: np.ndarray) -> float:
    """Return the residual sum of squares of a linear regression."""
    weights = np.linalg.lstsq(columns.T, residual, rcond=None)[0]
    rest = residual - weights @ columns
    return float(rest @ rest)
