"""Interface of networks in inference, and the choice of the fastest available backend."""

from typing import TYPE_CHECKING, Protocol

import numpy as np

if TYPE_CHECKING:
    from nas_data.models.lstm import DynamicsModel


class InferenceNetwork(Protocol):
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


def prepare_inference(model: "DynamicsModel", size: int) -> InferenceNetwork:
    """Return a frozen copy of a model for B rows, on ONNX Runtime if installed, else on torch.

    Args:
        model: φ or ψ; later training does not change the copy.
        size: Number of rows, B.
    """
    try:
        from nas_data.models.inference.onnx_network import OnnxNetwork, OnnxTorques
    except ImportError:
        from nas_data.models.inference.torch_network import TorchNetwork

        return TorchNetwork(model, size)
    return OnnxTorques(model, size) if model.corrects == "command" else OnnxNetwork(model, size)
