"""A trained network on torch: the reference, and the fallback without ONNX Runtime."""

import copy

import numpy as np
import torch

from nas_data.models.inference.base import InferenceNetwork
from nas_data.models.lstm import DynamicsModel


class TorchNetwork(InferenceNetwork):
    """A copy of the model, called with batches of one time step."""

    def __init__(self, model: DynamicsModel, size: int) -> None:
        """Copy a model's weights for B rows; see `prepare_inference`."""
        self.size = size
        self._model = copy.deepcopy(model).cpu().eval().requires_grad_(False)
        self._memory = self._model.initial_memory(size)

    def changes(self, states: np.ndarray, commands: np.ndarray, predicted: np.ndarray) -> np.ndarray:
        """Process one control step; see `InferenceNetwork.changes`."""
        with torch.no_grad():
            change, self._memory = self._model.changes(
                as_input(states), as_input(commands), as_input(predicted), self._memory
            )
        return np.asarray(change[:, 0])

    def reset_memory(self, rows: np.ndarray | slice) -> None:
        """Zero the memory of some rows."""
        for memory in self._memory:
            memory[:, rows] = 0


def as_input(array: np.ndarray) -> torch.Tensor:
    """Return a batch of one time step, shape (B, 1, d), float32."""
    return torch.from_numpy(np.asarray(array, dtype=np.float32))[:, None]
