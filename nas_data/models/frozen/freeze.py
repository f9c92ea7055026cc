"""Which way to step a frozen network is the fastest one present."""

from nas_data.models.frozen.base import FrozenNetwork
from nas_data.models.frozen.torch_network import TorchNetwork
from nas_data.models.lstm import DynamicsModel


def freeze(model: DynamicsModel, size: int) -> FrozenNetwork:
    """Return a network with the model's present weights for B rows: by ONNX Runtime, or by torch where that is absent.

    Args:
        model: φ or ψ; what is learned later does not reach the network.
        size: Number of rows, B.
    """
    try:
        from nas_data.models.frozen.onnx_network import OnnxNetwork
        from nas_data.models.frozen.onnx_torques import OnnxTorques
    except ImportError:
        return TorchNetwork(model, size)
    return OnnxTorques(model, size) if model.corrects == "command" else OnnxNetwork(model, size)
