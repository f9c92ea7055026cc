"""Interface of frozen networks."""

from typing import Protocol

import numpy as np


class FrozenNetwork(Protocol):
    """φ or ψ for a batch of B closed loops, with the memory of each."""

    size: int

    def changes(self, states: np.ndarray, commands: np.ndarray, predicted: np.ndarray) -> np.ndarray:
        """Process one control step, update the memory, and return the output; see `DynamicsModel.changes`.

        Args:
            states: Positions [rad] then velocities [rad/s], shape (B, 2n).
            commands: Positions [rad] or torques [N·m], shape (B, n).
            predicted: Simulated next states, shape (B, 2n); ψ ignores them.

        Returns:
            Changes of positions [rad] then velocities [rad/s], shape (B, 2n), or of torques [N·m], shape (B, n),
            float32; the next call overwrites the array.
        """

    def reset_memory(self, rows: np.ndarray | slice) -> None:
        """Zero the memory of some rows, as at an episode's start."""
