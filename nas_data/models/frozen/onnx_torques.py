"""A frozen φ that corrects torques, on ONNX Runtime."""

import numpy as np

from nas_data.models.frozen.onnx_network import OnnxNetwork
from nas_data.models.lstm import DynamicsModel


class OnnxTorques(OnnxNetwork):
    """A session whose batch contains the rows and, with a symmetry, their mirror images."""

    def __init__(self, model: DynamicsModel, size: int) -> None:
        """Copy a model's weights for B rows; see `freeze`."""
        self._symmetry = model.symmetry
        super().__init__(model, size, sides=2 if self._symmetry else 1)
        self._limit = model.get_buffer("limit").cpu().numpy()
        self._original, self._mirrored = self._inputs[:size], self._inputs[size:]
        if self._symmetry:
            self._input_signs = np.array(self._symmetry.input_signs(), np.float32)
            self._signs = np.array(self._symmetry.signs, np.float32)

    def changes(self, states: np.ndarray, commands: np.ndarray, predicted: np.ndarray) -> np.ndarray:
        """Process one control step; see `FrozenNetwork.changes`."""
        outputs = super().changes(states, commands, predicted)
        if self._symmetry:
            outputs = (outputs[: self.size] + outputs[self.size :] * self._signs) / 2
        return self._limit * np.tanh(outputs / self._limit)

    def _fill_inputs(self, states: np.ndarray, commands: np.ndarray, predicted: np.ndarray) -> None:
        """Write the inputs as `DynamicsModel.raw_inputs`, computed in float32."""
        n = self._joints
        if self._symmetry:
            self._symmetry.fill_inputs(self._original, states, commands)
            np.multiply(self._original, self._input_signs, out=self._mirrored)
        else:
            self._original[:, : 2 * n] = states
            self._original[:, 2 * n :] = commands
        self._inputs -= self._mean
