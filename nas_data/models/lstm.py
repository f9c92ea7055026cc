"""The learned models: φ corrects a simulator, ψ replaces it; both are LSTMs."""

from collections.abc import Mapping, Sequence
from typing import Literal, NamedTuple, get_args

import torch
from huggingface_hub import PyTorchModelHubMixin
from torch import Tensor, nn

from nas_data.errors import OptionError
from nas_data.models.presets import Corrected
from nas_data.models.stiction import hold_below_threshold
from nas_data.models.symmetry import Symmetry

Kind = Literal["delta", "forward"]
Memory = tuple[Tensor, Tensor]


class Scale(NamedTuple):
    """Mean and standard deviation that normalise a vector, shapes (d,)."""

    mean: Tensor
    std: Tensor

    def normalise(self, value: Tensor) -> Tensor:
        """Return (value − mean) / std."""
        return (value - self.mean) / self.std

    def restore(self, value: Tensor) -> Tensor:
        """Undo `normalise`."""
        return value * self.std + self.mean


class DynamicsModel(nn.Module, PyTorchModelHubMixin, library_name="nas_data", tags=["robotics"], license="apache-2.0"):
    """Linear + ReLU, LSTM layers, linear (Golemo et al. 2018, appendix A.1), with normalisation in its buffers.

    φ (kind `delta`): (state, command, simulated next state) → measured next − simulated next.
    ψ (kind `forward`): (state, command) → measured next − current.

    Two options are not in the paper; the paper's preset disables them. `relative` feeds differences (command −
    position, simulated next − state). They vary by degrees, while absolute angles vary by radians, so that the problem
    is better conditioned. `shortcut` adds a linear map from inputs to outputs, so that the LSTM only learns the
    nonlinear part; a linear error of the simulator can be cancelled exactly.

    If commands are torques, φ can correct them instead of states (`corrects`): it adds a torque to the command, and the
    source computes the next state. It then reads state and command only. It can be equivariant under the source's
    symmetry: it does not read the angles of cyclic joints, and its output for a mirror image is the mirror image of its
    output.

    With `stiction` φ has a threshold for each joint, which the network outputs as well: a joint stands still while its
    corrected displacement is below the threshold (`stiction.py`).

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
        corrects: Corrected = "state",
        cyclic: Sequence[str] = (),
        mirror: Mapping[str, float] | None = None,
        stiction: bool = False,
    ) -> None:
        """Build the network with random weights and neutral normalisation.

        Args:
            kind: `delta` for φ, `forward` for ψ.
            joints: Names of the n joints.
            hidden: Units of each LSTM layer; 128, 256 or 100 in the paper.
            layers: Number of LSTM layers; 3 in the paper.
            relative: Feed differences instead of absolute commands and predictions.
            shortcut: Add a linear map from inputs to outputs.
            commands_effort: Whether commands are fed unchanged, as torques and velocities are.
            fps: Control rate [Hz] of the data.
            provenance: Dataset (name, content hash), source and training options.
            corrects: Whether φ corrects the simulated next state (`state`) or the command (`command`).
            cyclic: Joints whose angle does not affect the dynamics; only with `command`.
            mirror: Angle [rad] about which each joint is mirrored in the mirror image; only with `command`.
            stiction: Whether joints stand still below a threshold; only for φ that corrects states.

        Raises:
            OptionError: the kind is unknown, or the options do not fit together.
        """
        super().__init__()
        if kind not in get_args(Kind):
            raise OptionError(f"kind is '{kind}'; choose delta or forward.")
        if corrects not in get_args(Corrected):
            raise OptionError(f"corrects is '{corrects}'; choose state or command.")
        if corrects == "command" and not (kind == "delta" and commands_effort):
            raise OptionError(
                "Only a delta model of a robot that takes torques corrects commands; use corrects='state'."
            )
        if (cyclic or mirror) and corrects == "state":
            raise OptionError("Only a model that corrects commands has a symmetry; leave out cyclic and mirror.")
        if stiction and (kind != "delta" or corrects != "state"):
            raise OptionError("Only a φ that corrects states has stiction; use stiction=False.")
        self.kind: Kind = kind
        self.joints = tuple(joints)
        self.relative = relative
        self.commands_effort = commands_effort
        self.fps = fps
        self.provenance = dict(provenance or {})
        self.corrects: Corrected = corrects
        self.stiction = stiction
        self.symmetry = Symmetry.from_names(joints, cyclic, mirror or {}) if cyclic or mirror else None
        n = len(self.joints)
        width = 5 * n if kind == "delta" and corrects == "state" else 3 * n
        width = self.symmetry.width if self.symmetry else width
        changed = 2 * n if corrects == "state" else n
        outputs = changed + n if stiction else changed
        self.inner = nn.Linear(width, hidden)
        self.lstm = nn.LSTM(hidden, hidden, layers, batch_first=True)
        self.outer = nn.Linear(hidden, outputs)
        self.shortcut = nn.Linear(width, outputs) if shortcut else None
        if corrects == "command":
            self.register_buffer("limit", torch.ones(n))
        if stiction:
            self.register_buffer("threshold_scale", torch.ones(n))
        for name, size in (("input", width), ("output", changed)):
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
        """Return the inputs of the network before normalisation.

        The shape is (…, 5n) for φ that corrects states, (…, 3n) for ψ and φ that corrects commands, and
        (…, `Symmetry.width`) with a symmetry.
        """
        if self.symmetry:
            return self.symmetry.read(states, commands)
        if self.corrects == "command":
            return torch.cat([states, commands], dim=-1)
        n = len(self.joints)
        if self.relative:
            predicted = predicted - states
            commands = commands if self.commands_effort else commands - states[..., :n]
        parts = [states, commands] + ([predicted] if self.kind == "delta" else [])
        return torch.cat(parts, dim=-1)

    def add_mirror_images(self, inputs: Tensor, outputs: Tensor) -> tuple[Tensor, Tensor]:
        """Return raw inputs (N, width) and outputs (N, …), followed by their mirror images if there is a symmetry."""
        if self.symmetry is None:
            return inputs, outputs
        input_signs, signs = inputs.new_tensor(self.symmetry.input_signs()), outputs.new_tensor(self.symmetry.signs)
        return torch.cat([inputs, input_signs * inputs]), torch.cat([outputs, signs * outputs])

    def forward(self, inputs: Tensor, memory: Memory | None = None) -> tuple[Tensor, Memory]:
        """Return normalised outputs (B, T, 2n or n) and the memory after them, for normalised inputs (B, T, width).

        With stiction the outputs for the thresholds follow, shape (B, T, 3n).
        """
        if self.symmetry is None:
            return self._run(inputs, memory)
        # mirrored inputs have mean 0, so that their sign can be changed after normalisation
        both = torch.cat([inputs, inputs * inputs.new_tensor(self.symmetry.input_signs())])
        outputs, memory = self._run(both, memory and (stack_sides(memory[0]), stack_sides(memory[1])))
        original, mirrored = outputs.chunk(2)
        mean = (original + mirrored * mirrored.new_tensor(self.symmetry.signs)) / 2
        return mean, (unstack_sides(memory[0]), unstack_sides(memory[1]))

    def _run(self, inputs: Tensor, memory: Memory | None) -> tuple[Tensor, Memory]:
        hidden, memory = self.lstm(torch.relu(self.inner(inputs)), memory)
        outputs = self.outer(hidden)
        if self.shortcut is not None:
            outputs = outputs + self.shortcut(inputs)
        return outputs, memory

    def changes(
        self, states: Tensor, commands: Tensor, predicted: Tensor, memory: Memory | None = None
    ) -> tuple[Tensor, Memory]:
        """Return the output in physical units, and the next memory.

        φ's output is added to the simulated next state (B, T, 2n) or to the command (B, T, n). ψ's output is added to
        the state (B, T, 2n).
        """
        outputs, memory = self(self.inputs.normalise(self.raw_inputs(states, commands, predicted)), memory)
        changes = self.outputs.restore(outputs[..., : len(self.outputs.std)])
        if self.stiction:
            scale, thresholds = self.get_buffer("threshold_scale"), outputs[..., len(self.outputs.std) :]
            changes = hold_below_threshold(changes, thresholds, scale, states, predicted)
        if self.corrects == "command":
            limit = self.get_buffer("limit")
            changes = limit * torch.tanh(changes / limit)
        return changes, memory

    def next_states(
        self, states: Tensor, commands: Tensor, predicted: Tensor, memory: Memory | None = None
    ) -> tuple[Tensor, Memory]:
        """Return predicted next states (B, T, 2n), and the next memory, of a model that does not correct commands.

        ψ ignores `predicted`; pass the states.
        """
        assert self.corrects == "state"
        change, memory = self.changes(states, commands, predicted, memory)
        return (predicted if self.kind == "delta" else states) + change, memory

    def initial_memory(self, size: int) -> Memory:
        """Return the memory of B rows at an episode's start: zeros, each of shape (layers, B, hidden).

        With a mirror symmetry the shape is (layers, B, 2 hidden), for both sides.
        """
        weight, sides = self.inner.weight, 2 if self.symmetry else 1
        zeros = weight.new_zeros(self.lstm.num_layers, size, sides * self.lstm.hidden_size)
        return zeros, zeros.clone()


def stack_sides(memory: Tensor) -> Tensor:
    """Return the memory of both sides (layers, B, 2 hidden) as that of a double batch (layers, 2B, hidden)."""
    return torch.cat(memory.chunk(2, dim=2), dim=1)


def unstack_sides(memory: Tensor) -> Tensor:
    """Undo `stack_sides`."""
    return torch.cat(memory.chunk(2, dim=1), dim=2)
