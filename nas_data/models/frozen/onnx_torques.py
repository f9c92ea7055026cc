"""A frozen φ of torques stepped by ONNX Runtime; where it knows a mirror image, both sides are rows of one batch."""

import numpy as np

from nas_data.models.frozen.onnx_network import OnnxNetwork
from nas_data.models.lstm import DynamicsModel


class OnnxTorques(OnnxNetwork):
    """A session whose rows are read as `DynamicsModel.raw_inputs` has them of commands, and their mirror images."""

    def __init__(self, model: DynamicsModel, size: int) -> None:
        """Take a model's present weights, for B rows; see `freeze`."""
        self._symmetry = model.symmetry
        super().__init__(model, size, sides=2 if self._symmetry else 1)
        self._limit = model.get_buffer("limit").cpu().numpy()
        self._here, self._there = self._inputs[:size], self._inputs[size:]
        if self._symmetry:
            self._input_signs = np.array(self._symmetry.input_signs(), np.float32)
            self._signs = np.array(self._symmetry.signs, np.float32)

    def changes(self, states: np.ndarray, commands: np.ndarray, predicted: np.ndarray) -> np.ndarray:
        """Read one control step; see `FrozenNetwork.changes`."""
        said = super().changes(states, commands, predicted)
        if self._symmetry:
            said = (said[: self.size] + said[self.size :] * self._signs) / 2
        return self._limit * np.tanh(said / self._limit)

    def _read(self, states: np.ndarray, commands: np.ndarray, predicted: np.ndarray) -> None:
        """Fill the inputs, in float32 from the start."""
        n = self._joints
        if self._symmetry:
            self._symmetry.fill(self._here, states, commands)
            np.multiply(self._here, self._input_signs, out=self._there)
        else:
            self._here[:, : 2 * n] = states
            self._here[:, 2 * n :] = commands
        self._inputs -= self._mean
