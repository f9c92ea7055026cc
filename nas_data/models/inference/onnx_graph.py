"""One time step of a learned model as an ONNX graph."""

import numpy as np
from onnx import ModelProto, NodeProto, TensorProto, ValueInfoProto, helper, numpy_helper
from torch import Tensor
from torch.nn import functional

from nas_data.models.lstm import DynamicsModel

OPSET, IR_VERSION = 17, 9  # of 2022: every ONNX Runtime for the Python versions of this package supports them
GATES = [0, 3, 1, 2]  # order in torch: input, forget, cell, output; in ONNX: input, output, forget, cell
INPUTS, CHANGES = "inputs", "changes"


def name_hidden_state(layer: int, after: bool) -> str:
    """Return the name of a layer's hidden state before or after the step."""
    return f"hidden{layer}_{'after' if after else 'before'}"


def name_cell_state(layer: int, after: bool) -> str:
    """Return the name of a layer's cell state before or after the step."""
    return f"cell{layer}_{'after' if after else 'before'}"


def build_graph(model: DynamicsModel, size: int) -> ModelProto:
    """Return the graph for a batch of fixed size.

    Inputs are `DynamicsModel.raw_inputs` minus `input_mean`, shape (B, width), and hidden and cell state of each layer,
    shape (1, B, hidden). Outputs are the changes in physical units, shape (B, 2n or n), with stiction followed by the
    outputs for the thresholds, (B, 3n), and the next hidden and cell states. The scales of the normalisation are part
    of the weights.

    Args:
        model: φ or ψ.
        size: Number of rows, B.
    """
    layers, hidden = model.lstm.num_layers, model.lstm.hidden_size
    weights = collect_linear_weights(model) | {
        key: value for k in range(layers) for key, value in collect_lstm_weights(model, k)
    }
    memory = layers, (1, size, hidden)
    graph = helper.make_graph(
        build_nodes(model, layers, hidden),
        "one_step",
        [declare(INPUTS, (size, model.inner.in_features)), *declare_memory(*memory, after=False)],
        [declare(CHANGES, (size, model.outer.out_features)), *declare_memory(*memory, after=True)],
        [numpy_helper.from_array(value, name) for name, value in weights.items()],
    )
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=IR_VERSION)


def build_nodes(model: DynamicsModel, layers: int, hidden: int) -> list[NodeProto]:
    """Return the operations in order."""
    made = [
        helper.make_node("Gemm", [INPUTS, "inner_weight", "inner_bias"], ["inner"], transB=1),
        helper.make_node("Relu", ["inner"], ["read"]),
        helper.make_node("Unsqueeze", ["read", "time"], ["read_step"]),
    ]
    for layer in range(layers):
        source = name_hidden_state(layer - 1, after=True) if layer else "read_step"
        before = [name_hidden_state(layer, after=False), name_cell_state(layer, after=False)]
        after = ["", name_hidden_state(layer, after=True), name_cell_state(layer, after=True)]
        given = [source, f"w{layer}", f"r{layer}", f"b{layer}", "", *before]
        made.append(helper.make_node("LSTM", given, after, hidden_size=hidden))
    made.append(helper.make_node("Squeeze", [name_hidden_state(layers - 1, after=True), "time"], ["last"]))
    bias = "outer_bias"
    if model.shortcut is not None:
        made.append(helper.make_node("Gemm", [INPUTS, "shortcut_weight", bias], ["linear"], transB=1))
        bias = "linear"
    made.append(helper.make_node("Gemm", ["last", "outer_weight", bias], [CHANGES], transB=1))
    return made


def collect_linear_weights(model: DynamicsModel) -> dict[str, np.ndarray]:
    """Return the weights of the linear layers, including the scales of inputs and outputs."""
    thresholds = model.outer.out_features - len(model.outputs.std)  # their outputs are not normalised
    input_scale = model.inputs.std.double()
    mean = functional.pad(model.outputs.mean.double(), (0, thresholds))
    output_scale = functional.pad(model.outputs.std.double(), (0, thresholds), value=1.0)[:, None]
    bias, shortcut = model.outer.bias.double(), {}
    if model.shortcut is not None:
        bias = bias + model.shortcut.bias.double()
        shortcut = {"shortcut_weight": to_array(model.shortcut.weight.double() / input_scale * output_scale)}
    return shortcut | {
        "inner_weight": to_array(model.inner.weight.double() / input_scale),
        "inner_bias": to_array(model.inner.bias),
        "outer_weight": to_array(model.outer.weight.double() * output_scale),
        "outer_bias": to_array(bias * output_scale[:, 0] + mean),
        "time": np.array([0]),  # index of the time axis
    }


def collect_lstm_weights(model: DynamicsModel, layer: int) -> list[tuple[str, np.ndarray]]:
    """Return a layer's input and recurrent weights, shape (1, 4 hidden, …), and biases, shape (1, 8 hidden)."""
    parts = {
        name: reorder_gates(getattr(model.lstm, f"{name}_l{layer}"))
        for name in ("weight_ih", "weight_hh", "bias_ih", "bias_hh")
    }
    biases = np.concatenate([parts["bias_ih"], parts["bias_hh"]])
    arrays = (parts["weight_ih"], parts["weight_hh"], biases)
    return [(f"{name}{layer}", array[None]) for name, array in zip("wrb", arrays, strict=True)]


def reorder_gates(weight: Tensor) -> np.ndarray:
    """Reorder the gates, stacked along the first axis, from torch's to ONNX's order."""
    return np.concatenate([np.split(to_array(weight), 4)[gate] for gate in GATES])


def to_array(tensor: Tensor) -> np.ndarray:
    """Return a tensor as a float32 array."""
    return np.asarray(tensor.detach().cpu().float())


def declare(name: str, shape: tuple[int, ...]) -> ValueInfoProto:
    """Return the declaration of an input or output."""
    return helper.make_tensor_value_info(name, TensorProto.FLOAT, shape)


def declare_memory(layers: int, shape: tuple[int, ...], after: bool) -> list[ValueInfoProto]:
    """Return the declarations of the hidden and cell states of all layers."""
    return [
        declare(name(layer, after), shape) for layer in range(layers) for name in (name_hidden_state, name_cell_state)
    ]
