"""What a frozen network is: something that says for a whole batch by how much it changes the next states."""

from typing import Protocol

import numpy as np


class FrozenNetwork(Protocol):
    """φ or ψ for a batch of B closed loops, with what it remembers of each."""

    size: int

    def changes(self, states: np.ndarray, commands: np.ndarray, predicted: np.ndarray) -> np.ndarray:
        """Read one control step, remember it, and return what is added; see `DynamicsModel.changes`.

        Args:
            states: Positions [rad] then velocities [rad/s], shape (B, 2n).
            commands: Positions [rad] or torques [N·m], shape (B, n).
            predicted: Simulated next states, shape (B, 2n); ψ ignores them.

        Returns:
            Changes of positions [rad] then velocities [rad/s], shape (B, 2n), or of torques [N·m], shape (B, n),
            float32; overwritten by the next call.
        """

    def forget(self, rows: np.ndarray | slice) -> None:
        """Zero what is remembered of some rows, as at an episode's start."""
