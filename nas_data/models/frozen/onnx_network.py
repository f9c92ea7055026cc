"""A frozen network stepped by ONNX Runtime on one thread: at the sizes of a policy's batch, the fastest way."""

import numpy as np
import onnxruntime

from nas_data.models.frozen.base import FrozenNetwork
from nas_data.models.frozen.onnx_graph import CHANGES, INPUTS, cell_name, hidden_name, one_step
from nas_data.models.lstm import DynamicsModel

ERRORS = 3  # ONNX Runtime's level of what it logs


class OnnxNetwork(FrozenNetwork):
    """A session for a fixed number of rows that reads and writes our arrays in place.

    What is remembered lies in one array, twice: a step reads one half and writes the other.
    """

    def __init__(self, model: DynamicsModel, size: int, sides: int = 1) -> None:
        """Take a model's present weights, for B rows, each of which stands in the batch so many times; see `freeze`."""
        self.size, rows = size, sides * size
        self._joints = len(model.joints)
        self._relative, self._delta = model.relative, model.kind == "delta"
        self._from_position = model.relative and not model.commands_effort
        self._mean = model.inputs.mean.cpu().numpy()
        self._inputs = np.zeros((rows, model.inner.in_features), np.float32)
        self._changes = np.zeros((rows, model.outer.out_features), np.float32)
        self._memory = np.zeros((2, model.lstm.num_layers, 2, rows, model.lstm.hidden_size), np.float32)
        self._by_row = self._memory.reshape(*self._memory.shape[:3], sides, size, -1)
        self._session = session(one_step(model, rows).SerializeToString())
        self._bindings = [self._bind(self._memory[turn], self._memory[1 - turn]) for turn in (0, 1)]
        self._turn = 0

    def changes(self, states: np.ndarray, commands: np.ndarray, predicted: np.ndarray) -> np.ndarray:
        """Read one control step; see `FrozenNetwork.changes`."""
        self._read(states, commands, predicted)
        self._session.run_with_iobinding(self._bindings[self._turn])
        self._turn = 1 - self._turn
        return self._changes

    def forget(self, rows: np.ndarray | slice) -> None:
        """Zero what is remembered of some rows."""
        self._by_row[:, :, :, :, rows] = 0

    def _read(self, states: np.ndarray, commands: np.ndarray, predicted: np.ndarray) -> None:
        """Fill the inputs; in float32 from the start, as `DynamicsModel.raw_inputs` is given them."""
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
        """Tell the session where its inputs and outputs lie, hidden and cell states (layers, 2, B, hidden)."""
        binding = self._session.io_binding()
        given: dict[str, np.ndarray] = {INPUTS: self._inputs}
        made: dict[str, np.ndarray] = {CHANGES: self._changes}
        for layer in range(len(before)):
            for part, name in enumerate((hidden_name, cell_name)):
                given[name(layer, after=False)] = before[layer, part, None]
                made[name(layer, after=True)] = after[layer, part, None]
        for key, array in given.items():
            binding.bind_input(key, "cpu", 0, np.float32, array.shape, array.ctypes.data)
        for key, array in made.items():
            binding.bind_output(key, "cpu", 0, np.float32, array.shape, array.ctypes.data)
        return binding


def session(graph: bytes) -> onnxruntime.InferenceSession:
    """Return a session on one thread: the batches are too small to share, and other cores have other seeds to train."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = ERRORS
    return onnxruntime.InferenceSession(graph, options, providers=["CPUExecutionProvider"])
