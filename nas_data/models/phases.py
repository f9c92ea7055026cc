"""The two phases of training: teacher forcing on measured states, then free running on the model's own."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from nas_data.models.episodes import Episode, cut, join, pad
from nas_data.models.lstm import DynamicsModel
from nas_data.models.presets import TrainingOptions
from nas_data.simulators.base import Simulator

SHORTEST = 20  # frames of the first free-running windows
JACOBIAN_SAMPLES = 400
POSITION_STEP = 0.03  # [rad] large enough to average over friction and saturation
VELOCITY_STEP = 0.3  # [rad/s]
VELOCITY_WEIGHT = 0.02  # of squared, normalised velocity errors beside position errors
POSITION_SCALE = 0.1  # of the positions' spread: errors beyond three times this count linearly


class Phase(Protocol):
    """A number of updates, each with a loss; draws depend on the update's number alone, so that it can resume."""

    name: str
    updates: int
    rate: float
    per_validation: int

    def loss(self, update: int) -> Tensor:
        """Return the loss of one update."""


class TeacherForcing:
    """One-step errors along measured trajectories, the memory running through each (algorithm 1 of the paper)."""

    name = "teacher forcing"

    def __init__(
        self, model: DynamicsModel, episodes: Sequence[Episode], options: TrainingOptions, device: torch.device
    ) -> None:
        """Cut the episodes into segments."""
        self.model = model
        self.device = device
        self.options = options
        self.segments = cut(episodes, options.segment)
        self.per_validation = -(-len(self.segments) // options.batch)
        self.updates = options.epochs * self.per_validation
        self.rate = options.rate
        self.bf16 = options.bf16 and device.type == "cpu" and processor_has_bf16()

    def loss(self, update: int) -> Tensor:
        """Return the mean squared normalised error of one batch of segments."""
        epoch, place = divmod(update, self.per_validation)
        order = np.random.default_rng([self.options.seed, 1, epoch]).permutation(len(self.segments))
        chosen = order[place * self.options.batch : (place + 1) * self.options.batch]
        batch, mask = pad([self.segments[index] for index in chosen])
        with torch.autocast("cpu", torch.bfloat16, enabled=self.bf16):
            return one_step_loss(self.model, batch, mask, self.device)


def one_step_loss(model: DynamicsModel, batch: Episode, mask: Tensor, device: torch.device) -> Tensor:
    """Return the mean squared normalised error over the true frames of a padded batch (B, T, …)."""
    states, commands, predicted = (x.to(device) for x in (batch.states, batch.commands, batch.predicted))
    base = predicted if model.kind == "delta" else states
    wanted = model.outputs.normalise(batch.targets.to(device) - base)
    outputs, _ = model(model.inputs.normalise(model.raw_inputs(states, commands, predicted)))
    return (outputs.float() - wanted)[mask.to(device)].square().mean()


class FreeRunning:
    """Errors of rollouts on the model's own states, with the source in the loop; what a policy will live in.

    The gradient runs through the whole window: through the network exactly, through the source by its Jacobian
    averaged over the data (friction and saturation make the local one useless).
    """

    name = "free running"
    per_validation = 40

    def __init__(
        self,
        model: DynamicsModel,
        episodes: Sequence[Episode],
        simulator: Simulator | None,
        options: TrainingOptions,
        device: torch.device,
    ) -> None:
        """Measure scales and the source's Jacobian.

        Args:
            model: φ or ψ.
            episodes: Training episodes.
            simulator: Source; needed for φ only.
            options: Windows, frames, learning rate, seed.
            device: Where the network lives.
        """
        self.model = model
        self.episodes = [episode for episode in episodes if len(episode) > 1]
        self.options = options
        self.device = device
        self.updates = options.updates
        self.rate = options.free_rate
        self.horizon = min(options.horizon, max(len(episode) for episode in self.episodes))
        everything = join(self.episodes)
        n = len(model.joints)
        deviation = everything.states.std(0, correction=0)
        self.position_scale = float(POSITION_SCALE * deviation[:n].mean().clamp_min(1e-6))
        self.velocity_scale = float(deviation[n:].mean().clamp_min(1e-6))
        self.simulator = simulator if model.kind == "delta" else None
        self.jacobian = self._mean_jacobian(self.simulator, everything) if self.simulator is not None else None

    def loss(self, update: int) -> Tensor:
        """Return the loss of one batch of windows: smooth absolute position errors, squared velocity errors."""
        batch = self._windows(update)
        states = batch.states[:, 0].to(self.device)
        commands = batch.commands.to(self.device)
        errors, memory = [], None
        for step in range(commands.shape[1]):
            predicted = self._predict(states, commands[:, step])
            corrected, memory = self.model.next_states(
                states[:, None], commands[:, step, None], predicted[:, None], memory
            )
            states = corrected[:, 0]
            errors.append(states - batch.targets[:, step].to(self.device))
        n = len(self.model.joints)
        error = torch.stack(errors, dim=1)
        position = error[..., :n] / self.position_scale
        velocity = error[..., n:] / self.velocity_scale
        smooth = functional.smooth_l1_loss(position, torch.zeros_like(position), beta=3.0)
        return smooth + VELOCITY_WEIGHT * velocity.square().mean()

    def _windows(self, update: int) -> Episode:
        """Draw windows of equal length, longer ones later, starting anywhere in the training episodes."""
        rng = np.random.default_rng([self.options.seed, 2, update])
        grown = min(1.0, 2 * update / max(1, self.updates))
        length = int(min(SHORTEST, self.horizon) + grown * max(0, self.horizon - SHORTEST))
        long_enough = [episode for episode in self.episodes if len(episode) >= length]
        weights = np.array([len(episode) for episode in long_enough], dtype=float)
        count = max(8, self.options.frames // length)
        chosen = rng.choice(len(long_enough), count, p=weights / weights.sum())
        starts = [int(rng.integers(len(long_enough[index]) - length + 1)) for index in chosen]
        windows = [long_enough[index].window(start, length) for index, start in zip(chosen, starts, strict=True)]
        return pad(windows)[0]

    def _predict(self, states: Tensor, commands: Tensor) -> Tensor:
        """Return the source's next states, differentiable by its mean Jacobian; the states themselves for ψ."""
        if self.simulator is None or self.jacobian is None:
            return states
        exact = self.simulator.predict(
            states.detach().cpu().numpy().astype(np.float64), commands.cpu().numpy().astype(np.float64)
        )
        followed = states @ self.jacobian.T
        return followed + (torch.from_numpy(exact).float().to(self.device) - followed).detach()

    def _mean_jacobian(self, simulator: Simulator, transitions: Episode) -> Tensor:
        """Return ∂(simulated next state)/∂(state) averaged over the data, shape (2n, 2n), by central differences."""
        rng = np.random.default_rng([self.options.seed, 3])
        rows = rng.choice(len(transitions), min(JACOBIAN_SAMPLES, len(transitions)), replace=False)
        states, commands = transitions.states[rows].double().numpy(), transitions.commands[rows].double().numpy()
        return torch.from_numpy(mean_jacobian(simulator, states, commands)).float().to(self.device)


def mean_jacobian(simulator: Simulator, states: np.ndarray, commands: np.ndarray) -> np.ndarray:
    """Average the Jacobian of one control step over transitions.

    Args:
        simulator: Source.
        states: Positions [rad] then velocities [rad/s], shape (N, 2n).
        commands: Shape (N, n).

    Returns:
        Entry (i, j) is the change of next state i per change of state j, shape (2n, 2n).
    """
    width = states.shape[1]
    steps = np.where(np.arange(width) < width // 2, POSITION_STEP, VELOCITY_STEP)
    columns = []
    for offset in np.diag(steps):
        ahead, behind = simulator.predict(states + offset, commands), simulator.predict(states - offset, commands)
        columns.append((ahead - behind).mean(axis=0) / (2 * offset.sum()))
    return np.stack(columns, axis=1)


def processor_has_bf16() -> bool:
    """Whether bfloat16 matrix products run in hardware; elsewhere they are slower than float32."""
    return bool(torch.cpu._is_avx512_bf16_supported())
