"""A frozen network stepped by torch: the reference, and the way where ONNX Runtime is absent."""

import copy

import numpy as np
import torch

from nas_data.models.frozen.base import FrozenNetwork
from nas_data.models.lstm import DynamicsModel


class TorchNetwork(FrozenNetwork):
    """The model itself, called with batches of one time step."""

    def __init__(self, model: DynamicsModel, size: int) -> None:
        """Take a model's present weights, for B rows; see `freeze`."""
        self.size = size
        self._model = copy.deepcopy(model).cpu().eval().requires_grad_(False)
        self._memory = self._model.no_memory(size)

    def changes(self, states: np.ndarray, commands: np.ndarray, predicted: np.ndarray) -> np.ndarray:
        """Read one control step; see `FrozenNetwork.changes`."""
        with torch.no_grad():
            change, self._memory = self._model.changes(
                as_input(states), as_input(commands), as_input(predicted), self._memory
            )
        return np.asarray(change[:, 0])

    def forget(self, rows: np.ndarray | slice) -> None:
        """Zero what is remembered of some rows."""
        for memory in self._memory:
            memory[:, rows] = 0


def as_input(array: np.ndarray) -> torch.Tensor:
    """Return a batch of one time step, shape (B, 1, d), float32."""
    return torch.from_numpy(np.asarray(array, dtype=np.float32))[:, None]
