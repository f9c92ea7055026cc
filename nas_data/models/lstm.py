"""The learned models: φ corrects a simulator, ψ replaces it; both are one LSTM that reads state and command."""

from collections.abc import Mapping, Sequence
from typing import Literal, NamedTuple, get_args

import torch
from huggingface_hub import PyTorchModelHubMixin
from torch import Tensor, nn

Kind = Literal["delta", "forward"]
Memory = tuple[Tensor, Tensor]


class Scale(NamedTuple):
    """Mean and standard deviation that normalise a vector, shapes (d,)."""

    mean: Tensor
    std: Tensor

    def normalise(self, value: Tensor) -> Tensor:
        """Return the value in units of the spread."""
        return (value - self.mean) / self.std

    def restore(self, value: Tensor) -> Tensor:
        """Undo `normalise`."""
        return value * self.std + self.mean


class DynamicsModel(nn.Module, PyTorchModelHubMixin, library_name="nas_data", tags=["robotics"], license="apache-2.0"):
    """Linear + ReLU, LSTM layers, linear (Golemo et al. 2018, appendix A.1), with normalisation in its buffers.

    φ (kind `delta`): (state, command, simulated next state) → measured next − simulated next.
    ψ (kind `forward`): (state, command) → measured next − current.

    Two additions over the paper, both switched off in its preset. `relative` feeds differences (command − position,
    simulated next − state), which spread over degrees where absolute angles spread over radians: the same
    information in better condition. `shortcut` adds a linear map from inputs to outputs, so that the LSTM learns
    only what is not linear; it lets a correction cancel a wrong simulator exactly.

    States are joint positions [rad] then velocities [rad/s], shape (…, 2n); commands (…, n).
    """

    def __init__(
        self,
        kind: Kind,
        joints: Sequence[str],
        hidden: int = 128,
        layers: int = 3,
        relative: bool = True,
        shortcut: bool = True,
        commands_effort: bool = False,
        fps: float = 50.0,
        provenance: Mapping[str, object] | None = None,
    ) -> None:
        """Build the network with random weights and neutral normalisation.

        Args:
            kind: `delta` for φ, `forward` for ψ.
            joints: Names of the n joints.
            hidden: Units of each LSTM layer; 128, 256 or 100 in the paper.
            layers: LSTM layers; 3 in the paper.
            relative: Feed differences instead of absolute commands and predictions.
            shortcut: Add a linear map from inputs to outputs.
            commands_effort: Commands are torques [N·m]; then they are fed as they are.
            fps: Control rate [Hz] of the data.
            provenance: Dataset (name, content hash), source and training options.

        Raises:
            ValueError: there is no such kind.
        """
        super().__init__()
        if kind not in get_args(Kind):
            raise ValueError(f"kind is '{kind}', not delta or forward")
        self.kind: Kind = kind
        self.joints = tuple(joints)
        self.relative = relative
        self.commands_effort = commands_effort
        self.fps = fps
        self.provenance = dict(provenance or {})
        n = len(self.joints)
        width = 5 * n if kind == "delta" else 3 * n
        self.inner = nn.Linear(width, hidden)
        self.lstm = nn.LSTM(hidden, hidden, layers, batch_first=True)
        self.outer = nn.Linear(hidden, 2 * n)
        self.shortcut = nn.Linear(width, 2 * n) if shortcut else None
        for name, size in (("input", width), ("output", 2 * n)):
            self.register_buffer(f"{name}_mean", torch.zeros(size))
            self.register_buffer(f"{name}_std", torch.ones(size))

    @property
    def inputs(self) -> Scale:
        """Normalisation of the inputs."""
        return Scale(self.get_buffer("input_mean"), self.get_buffer("input_std"))

    @property
    def outputs(self) -> Scale:
        """Normalisation of the outputs."""
        return Scale(self.get_buffer("output_mean"), self.get_buffer("output_std"))

    def raw_inputs(self, states: Tensor, commands: Tensor, predicted: Tensor) -> Tensor:
        """Return what the network reads before normalisation, shape (…, 5n) for φ and (…, 3n) for ψ."""
        n = len(self.joints)
        if self.relative:
            predicted = predicted - states
            commands = commands if self.commands_effort else commands - states[..., :n]
        parts = [states, commands] + ([predicted] if self.kind == "delta" else [])
        return torch.cat(parts, dim=-1)

    def forward(self, inputs: Tensor, memory: Memory | None = None) -> tuple[Tensor, Memory]:
        """Return normalised outputs (B, T, 2n) and the memory after them, for normalised inputs (B, T, width)."""
        hidden, memory = self.lstm(torch.relu(self.inner(inputs)), memory)
        outputs = self.outer(hidden)
        if self.shortcut is not None:
            outputs = outputs + self.shortcut(inputs)
        return outputs, memory

    def changes(
        self, states: Tensor, commands: Tensor, predicted: Tensor, memory: Memory | None = None
    ) -> tuple[Tensor, Memory]:
        """Return what φ adds to the simulated next state, and ψ to the state, in physical units (B, T, 2n)."""
        outputs, memory = self(self.inputs.normalise(self.raw_inputs(states, commands, predicted)), memory)
        return self.outputs.restore(outputs), memory

    def next_states(
        self, states: Tensor, commands: Tensor, predicted: Tensor, memory: Memory | None = None
    ) -> tuple[Tensor, Memory]:
        """Return corrected next states (B, T, 2n) for states, commands and simulated next states (B, T, …).

        ψ ignores `predicted`; pass the states.
        """
        change, memory = self.changes(states, commands, predicted, memory)
        return (predicted if self.kind == "delta" else states) + change, memory

    def no_memory(self, size: int) -> Memory:
        """Return the memory at an episode's start for a batch: zeros, each of shape (layers, B, hidden)."""
        weight = self.inner.weight
        zeros = weight.new_zeros(self.lstm.num_layers, size, self.lstm.hidden_size)
        return zeros, zeros.clone()
