"""Divergence of learned models, and predictions of a source from states that it may not be able to simulate."""

import numpy as np

from nas_data.errors import ModelFileError, SimulationDiverged
from nas_data.simulators.base import Simulator

BOUND = 1e6  # [rad or rad/s] a larger state means divergence; float32 resolves such angles to 0.06 rad only


def is_out_of_bounds(states: np.ndarray) -> np.ndarray:
    """Return a mask of the states (…, 2n) that are not finite or exceed `BOUND`, shape (…)."""
    return ~(np.abs(states) < BOUND).all(axis=-1)


def predict_bounded(simulator: Simulator, states: np.ndarray, commands: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Predict transitions, of which the source may be unable to simulate some.

    A simulator refuses a batch as a whole. Repeated halving finds the rows that it refuses.

    Args:
        simulator: Source.
        states: Positions [rad] then velocities [rad/s], shape (N, 2n), or with the objects' states (N, 2n + m).
        commands: Shape (N, n).

    Returns:
        Next states, shape as `states`, where refused rows keep their state; and whether rows were refused, shape (N,).
    """
    try:
        return simulator.predict(states, commands), np.zeros(len(states), bool)
    except (ModelFileError, SimulationDiverged):
        if len(states) == 1:
            return states.copy(), np.ones(1, bool)
    half = len(states) // 2
    parts = [predict_bounded(simulator, states[rows], commands[rows]) for rows in (slice(half), slice(half, None))]
    return np.concatenate([part[0] for part in parts]), np.concatenate([part[1] for part in parts])
