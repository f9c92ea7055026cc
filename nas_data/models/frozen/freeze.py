"""Choice of the fastest available backend for a frozen network."""

from nas_data.models.frozen.base import FrozenNetwork
from nas_data.models.frozen.torch_network import TorchNetwork
from nas_data.models.lstm import DynamicsModel


def freeze(model: DynamicsModel, size: int) -> FrozenNetwork:
    """Return a frozen copy of a model for B rows, on ONNX Runtime if installed, else on torch.

    Args:
        model: φ or ψ; later training does not change the copy.
        size: Number of rows, B.
    """
    try:
        from nas_data.models.frozen.onnx_network import OnnxNetwork, OnnxTorques
    except ImportError:
        return TorchNetwork(model, size)
    return OnnxTorques(model, size) if model.corrects == "command" else OnnxNetwork(model, size)
