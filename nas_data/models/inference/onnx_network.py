"""Trained networks on ONNX Runtime with one thread, the fastest backend for the batch sizes of policies."""

import numpy as np
import onnxruntime

from nas_data.models.inference.base import InferenceNetwork
from nas_data.models.inference.onnx_graph import CHANGES, INPUTS, build_graph, name_cell_state, name_hidden_state
from nas_data.models.lstm import DynamicsModel
from nas_data.models.stiction import hold_in_place

ERRORS = 3  # ONNX Runtime's log level for errors only


class OnnxNetwork(InferenceNetwork):
    """A session for a fixed number of rows that reads and writes preallocated arrays.

    The memory is double-buffered: a step reads one half of the array and writes the other.
    """

    def __init__(self, model: DynamicsModel, size: int, sides: int = 1) -> None:
        """Copy a model's weights for B rows, each of which is `sides` times in the batch; see `prepare_inference`."""
        self.size, rows = size, sides * size
        self._joints = len(model.joints)
        self._relative, self._delta = model.relative, model.kind == "delta"
        self._from_position = model.relative and not model.commands_effort
        self._threshold_scale = model.get_buffer("threshold_scale").cpu().numpy() if model.stiction else None
        self._mean = model.inputs.mean.cpu().numpy()
        self._inputs = np.zeros((rows, model.inner.in_features), np.float32)
        self._changes = np.zeros((rows, model.outer.out_features), np.float32)
        self._memory = np.zeros((2, model.lstm.num_layers, 2, rows, model.lstm.hidden_size), np.float32)
        self._by_row = self._memory.reshape(*self._memory.shape[:3], sides, size, -1)
        self._session = open_session(build_graph(model, rows).SerializeToString())
        self._bindings = [self._bind(self._memory[turn], self._memory[1 - turn]) for turn in (0, 1)]
        self._turn = 0

    def changes(self, states: np.ndarray, commands: np.ndarray, predicted: np.ndarray) -> np.ndarray:
        """Process one control step; see `InferenceNetwork.changes`."""
        self._fill_inputs(states, commands, predicted)
        self._session.run_with_iobinding(self._bindings[self._turn])
        self._turn = 1 - self._turn
        if self._threshold_scale is not None:
            return hold_in_place(self._changes, self._threshold_scale, states, predicted)
        return self._changes

    def reset_memory(self, rows: np.ndarray | slice) -> None:
        """Zero the memory of some rows."""
        self._by_row[:, :, :, :, rows] = 0

    def _fill_inputs(self, states: np.ndarray, commands: np.ndarray, predicted: np.ndarray) -> None:
        """Write the inputs as `DynamicsModel.raw_inputs`, computed in float32."""
        n, inputs = self._joints, self._inputs
        inputs[:, : 2 * n] = states
        inputs[:, 2 * n : 3 * n] = commands
        if self._from_position:
            inputs[:, 2 * n : 3 * n] -= inputs[:, :n]
        if self._delta:
            inputs[:, 3 * n :] = predicted
            if self._relative:
                inputs[:, 3 * n :] -= inputs[:, : 2 * n]
        inputs -= self._mean

    def _bind(self, before: np.ndarray, after: np.ndarray) -> onnxruntime.IOBinding:
        """Bind the session to its arrays; `before` and `after` are hidden and cell states (layers, 2, B, hidden)."""
        binding = self._session.io_binding()
        inputs: dict[str, np.ndarray] = {INPUTS: self._inputs}
        outputs: dict[str, np.ndarray] = {CHANGES: self._changes}
        for layer in range(len(before)):
            for part, name in enumerate((name_hidden_state, name_cell_state)):
                inputs[name(layer, after=False)] = before[layer, part, None]
                outputs[name(layer, after=True)] = after[layer, part, None]
        for key, array in inputs.items():
            binding.bind_input(key, "cpu", 0, np.float32, array.shape, array.ctypes.data)
        for key, array in outputs.items():
            binding.bind_output(key, "cpu", 0, np.float32, array.shape, array.ctypes.data)
        return binding


def open_session(graph: bytes) -> onnxruntime.InferenceSession:
    """Return a session on one thread: batches are small, and other cores train other seeds."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = ERRORS
    return onnxruntime.InferenceSession(graph, options, providers=["CPUExecutionProvider"])


class OnnxTorques(OnnxNetwork):
    """A session whose batch contains the rows and, with a symmetry, their mirror images."""

    def __init__(self, model: DynamicsModel, size: int) -> None:
        """Copy a model's weights for B rows; see `prepare_inference`."""
        self._symmetry = model.symmetry
        super().__init__(model, size, sides=2 if self._symmetry else 1)
        self._limit = model.get_buffer("limit").cpu().numpy()
        self._original, self._mirrored = self._inputs[:size], self._inputs[size:]
        if self._symmetry:
            self._input_signs = np.array(self._symmetry.input_signs(), np.float32)
            self._signs = np.array(self._symmetry.signs, np.float32)

    def changes(self, states: np.ndarray, commands: np.ndarray, predicted: np.ndarray) -> np.ndarray:
        """Process one control step; see `InferenceNetwork.changes`."""
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
