"""Losses of the two training modes: teacher forcing on measured states, and free running on the model's own."""

from collections.abc import Collection, Sequence
from typing import NamedTuple, Protocol

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from nas_data.errors import DatasetInvalid
from nas_data.joint_units import average_by_kind
from nas_data.models.divergence import predict_bounded
from nas_data.models.episodes import Episode, cut_episodes, join, pad
from nas_data.models.jacobians import estimate_jacobians
from nas_data.models.lstm import DynamicsModel, Memory
from nas_data.models.presets import TrainingOptions
from nas_data.models.stateful_source import start_at_windows, step_from
from nas_data.runs.progress import begin
from nas_data.simulators.base import Simulator, Stepper

SHORTEST = 20  # frames of the first free-running windows
MOST_JACOBIANS = 600_000  # half a gigabyte for 7 joints; in longer recordings neighbouring frames share a Jacobian
BURN_IN = 100  # frames read before a window to initialise the memory
VELOCITY_WEIGHT = 0.02  # weight of squared, normalised velocity errors relative to position errors
DIVERGED_DEVIATIONS = 30.0  # a rollout has diverged if its error exceeds this many standard deviations
POSITION_SCALE = 0.1  # unit of position errors over their standard deviation; errors above 3 units count linearly


class Phase(Protocol):
    """A sequence of updates; random draws depend only on the update's number, so that training can resume."""

    name: str
    updates: int
    rate: float
    per_validation: int

    def loss(self, update: int) -> Tensor:
        """Return the loss of one update."""


class TeacherForcing:
    """One-step errors along measured trajectories, with the LSTM state of each (algorithm 1 of the paper)."""

    name = "teacher forcing"

    def __init__(
        self, model: DynamicsModel, episodes: Sequence[Episode], options: TrainingOptions, device: torch.device
    ) -> None:
        """Cut the episodes into segments."""
        self.model = model
        self.device = device
        self.options = options
        self.segments = cut_episodes(episodes, options.segment)
        self.per_validation = -(-len(self.segments) // options.batch)
        self.updates = options.epochs * self.per_validation
        self.rate = options.rate
        self.bf16 = options.bf16 and device.type == "cpu" and has_cpu_bf16()

    def loss(self, update: int) -> Tensor:
        """Return the mean squared normalised error of one batch of segments."""
        epoch, batch_number = divmod(update, self.per_validation)
        order = np.random.default_rng([self.options.seed, 1, epoch]).permutation(len(self.segments))
        first = batch_number * self.options.batch
        chosen = order[first : first + self.options.batch]
        batch, mask = pad([self.segments[index] for index in chosen])
        with torch.autocast("cpu", torch.bfloat16, enabled=self.bf16):
            return compute_one_step_loss(self.model, batch, mask, self.device)


def compute_one_step_loss(model: DynamicsModel, batch: Episode, mask: Tensor, device: torch.device) -> Tensor:
    """Return the mean squared normalised error over the recorded frames of a padded batch (B, T, …)."""
    states, commands, predicted = (x.to(device) for x in (batch.states, batch.commands, batch.predicted))
    base = predicted if model.kind == "delta" else states
    wanted = model.outputs.normalise(batch.targets.to(device) - base)
    if model.stiction:
        outputs = model.outputs.normalise(model.changes(states, commands, predicted)[0])
    else:
        outputs, _ = model(model.inputs.normalise(model.raw_inputs(states, commands, predicted)))
    return (outputs.float() - wanted)[mask.to(device)].square().mean()


class FrameWindow(NamedTuple):
    """A window of an episode: index of the episode, first frame, number of frames."""

    episode: int
    start: int
    length: int


class StepInputs(NamedTuple):
    """Inputs of one step of a batch of rollouts.

    Attributes:
        states: Positions [rad] then velocities [rad/s], shape (B, 2n).
        commands: Shape (B, n).
        objects: Measured states of the source's objects, shape (B, m).
        jacobian: Source's Jacobians, shape (B, 2n, 2n or 3n); None for ψ.
    """

    states: Tensor
    commands: Tensor
    objects: Tensor
    jacobian: Tensor | None


class FreeRunning:
    """Errors of closed-loop rollouts on the model's own states, with the source in the loop.

    A window begins at the start of an episode with a zero LSTM state, or later, after the model has read the preceding
    measurements. The gradient passes through the whole window and is multiplied by the discount at each step. It is
    exact for the network; for the source it uses the Jacobian at the measured transition of the same time. If a rollout
    diverges, or the source cannot simulate it, it continues on the measured states, with a constant error and no
    gradient.
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
        slides: Collection[str] = (),
    ) -> None:
        """Compute the scales of errors and the source's Jacobians.

        Args:
            model: φ or ψ.
            episodes: Training episodes.
            simulator: Source; needed for φ only.
            options: Windows, frames, learning rate, seed.
            device: Device of the network.
            slides: Names of the slides. Errors are divided by the mean standard deviation of the hinges or slides.

        Raises:
            DatasetInvalid: no episode is longer than one transition.
        """
        self.model = model
        self.episodes = [episode for episode in episodes if len(episode) > 1]
        if not self.episodes:
            raise DatasetInvalid("No training episode has two transitions; record longer ones, or give 0 updates.")
        self.options = options
        self.device = device
        self.updates = options.updates
        self.rate = options.free_rate
        self.horizon = min(options.horizon, max(len(episode) for episode in self.episodes))
        everything = join(self.episodes)
        n = len(model.joints)
        deviation = everything.states.std(0, correction=0)
        self.position_scale = POSITION_SCALE * self._scale(deviation[:n], slides)
        self.velocity_scale = self._scale(deviation[n:], slides)
        self.simulator = simulator if model.kind == "delta" else None
        self.stride = -(-len(everything) // MOST_JACOBIANS)
        self.jacobians = None
        if self.simulator is not None:
            self.jacobians = []
            for number, episode in enumerate(self.episodes, 1):
                begin(f"linearising the source: episode {number} of {len(self.episodes)}")
                self.jacobians.append(self._estimate_jacobians(self.simulator, episode))

    def _scale(self, spread: Tensor, slides: Collection[str]) -> Tensor:
        """Return, for each joint, the mean of standard deviations (n,) over the joints of its kind, shape (n,)."""
        means = average_by_kind(spread.double().numpy(), self.model.joints, slides)
        return torch.from_numpy(means).float().clamp_min(1e-6).to(self.device)

    def _estimate_jacobians(self, simulator: Simulator, episode: Episode) -> Tensor:
        """Return the source's Jacobian at every `stride`-th transition of an episode, shape (K, 2n, 2n or 3n)."""
        scenes = torch.cat([episode.states, episode.objects], dim=1)
        columns = (scenes, episode.commands, episode.predicted)
        states, commands, predicted = (x[:: self.stride].double().numpy() for x in columns)
        if simulator.remembers:
            predicted = simulator.predict(states, commands)[:, : predicted.shape[1]]
        return torch.from_numpy(
            estimate_jacobians(simulator, states, commands, predicted, of_commands=self.model.corrects == "command")
        ).float()

    def loss(self, update: int) -> Tensor:
        """Return the loss of one batch of windows: smooth absolute position errors, squared velocity errors."""
        windows = self._draw_windows(update)
        batch, _ = pad([self.episodes[w.episode].window(w.start, w.length) for w in windows])
        jacobians = self._stack_window_jacobians(windows)
        states = batch.states[:, 0].to(self.device)
        commands = batch.commands.to(self.device)
        memory = self._read_history(windows)
        stepper = self._start_source(windows)
        diverged = torch.zeros(len(states), dtype=torch.bool, device=self.device)
        errors: list[Tensor] = []
        for step in range(commands.shape[1]):
            jacobian = None if jacobians is None else jacobians[:, step]
            inputs = StepInputs(states, commands[:, step], batch.objects[:, step], jacobian)
            states, refused, memory = self._step(inputs, stepper, memory)
            target = batch.targets[:, step].to(self.device)
            error = states - target
            states = torch.lerp(states.detach(), states, self.options.discount)  # same values, discounted gradient
            diverged = diverged | refused.to(self.device) | self._has_diverged(error.detach())
            if diverged.any():
                states = torch.where(diverged[:, None], target, states)
                held = errors[-1].detach() if errors else torch.zeros_like(error)
                error = torch.where(diverged[:, None], held, error)
            errors.append(error)
        n = len(self.model.joints)
        error = torch.stack(errors, dim=1)
        position = error[..., :n] / self.position_scale
        velocity = error[..., n:] / self.velocity_scale
        smooth = functional.smooth_l1_loss(position, torch.zeros_like(position), beta=3.0)
        return smooth + VELOCITY_WEIGHT * velocity.square().mean()

    def _step(self, inputs: StepInputs, stepper: Stepper | None, memory: Memory) -> tuple[Tensor, Tensor, Memory]:
        """Return the model's next states (B, 2n), whether the source refused rows (B,), and the next memory."""
        states, commands = inputs.states[:, None], inputs.commands[:, None]
        if self.model.corrects == "command":
            change, memory = self.model.changes(states, commands, states, memory)
            predicted, refused = self._predict(inputs._replace(commands=inputs.commands + change[:, 0]), stepper)
            return predicted, refused, memory
        predicted, refused = self._predict(inputs, stepper)
        corrected, memory = self.model.next_states(states, commands, predicted[:, None], memory)
        return corrected[:, 0], refused, memory

    def _has_diverged(self, error: Tensor) -> Tensor:
        """Return a mask of the rollouts that diverged and would dominate the loss, shape (B,), from errors (B, 2n)."""
        n = len(self.model.joints)
        near = (error[:, :n].abs() < DIVERGED_DEVIATIONS * self.position_scale / POSITION_SCALE).all(dim=1)
        return ~(near & (error[:, n:].abs() < DIVERGED_DEVIATIONS * self.velocity_scale).all(dim=1))

    def _draw_windows(self, update: int) -> list[FrameWindow]:
        """Draw windows of equal length, which grows with the updates; many windows begin with an episode."""
        rng = np.random.default_rng([self.options.seed, 2, update])
        growth = min(1.0, 2 * update / max(1, self.updates))
        length = int(min(SHORTEST, self.horizon) + growth * max(0, self.horizon - SHORTEST))
        long_enough = [index for index, episode in enumerate(self.episodes) if len(episode) >= length]
        weights = np.array([len(self.episodes[index]) for index in long_enough], dtype=float)
        chosen = rng.choice(long_enough, max(8, self.options.frames // length), p=weights / weights.sum())
        latest = np.array([len(self.episodes[index]) - length for index in chosen])
        starts = np.maximum(0, rng.integers(-length // 2, latest + 1))
        return [FrameWindow(int(index), int(start), length) for index, start in zip(chosen, starts, strict=True)]

    def _read_history(self, windows: Sequence[FrameWindow]) -> Memory:
        """Return the model's memory at the windows' starts, after reading up to `BURN_IN` frames before them."""
        memory = self.model.initial_memory(len(windows))
        late = [row for row, window in enumerate(windows) if window.start]
        if not late:
            return memory
        runs = [min(windows[row].start, BURN_IN) for row in late]
        before = [
            self.episodes[windows[row].episode].window(windows[row].start - run, run)
            for row, run in zip(late, runs, strict=True)
        ]
        with torch.no_grad():
            for length in sorted(set(runs)):
                rows = [k for k, run in enumerate(runs) if run == length]
                batch, _ = pad([before[k] for k in rows])
                states, commands = batch.states.to(self.device), batch.commands.to(self.device)
                _, (hidden, cell) = self.model.changes(states, commands, batch.predicted.to(self.device))
                places_in_batch = [late[k] for k in rows]
                memory[0][:, places_in_batch], memory[1][:, places_in_batch] = hidden, cell
        return memory

    def _start_source(self, windows: Sequence[FrameWindow]) -> Stepper | None:
        """Return the source, started at the windows; None if it has no unmeasured state."""
        if self.simulator is None or not self.simulator.remembers:
            return None
        episodes, starts = [self.episodes[w.episode] for w in windows], np.array([w.start for w in windows])
        return start_at_windows(self.simulator, episodes, starts, BURN_IN)

    def _predict(self, inputs: StepInputs, stepper: Stepper | None = None) -> tuple[Tensor, Tensor]:
        """Return the source's next states (B, 2n), with its Jacobian as gradient, and whether it refused rows (B,).

        Objects have their measured states; a source with unmeasured state simulates them. For ψ the next states are
        the states themselves.
        """
        states, commands, objects, jacobian = inputs
        if self.simulator is None or jacobian is None:
            return states, torch.zeros(len(states), dtype=torch.bool)
        numbers, commanded = (x.detach().cpu().numpy().astype(np.float64) for x in (states, commands))
        if stepper is None:
            scenes = np.concatenate([numbers, objects.double().numpy()], axis=1)
            wide, refused = predict_bounded(self.simulator, scenes, commanded)
            exact = wide[:, : numbers.shape[1]]
        else:
            exact = step_from(stepper, numbers, commanded)
            refused = ~np.isfinite(exact).all(axis=1)
            exact = np.where(refused[:, None], numbers, exact)
        variables = states if self.model.corrects == "state" else torch.cat([states, commands], dim=1)
        linear = (jacobian @ variables[:, :, None])[:, :, 0]
        predicted = linear + (torch.from_numpy(exact).float().to(self.device) - linear).detach()
        return predicted, torch.from_numpy(refused)

    def _stack_window_jacobians(self, windows: Sequence[FrameWindow]) -> Tensor | None:
        """Return the source's Jacobians along the windows, shape (B, T, 2n, 2n), or (B, T, 2n, 3n) with commands."""
        if self.jacobians is None:
            return None
        rows = [self.jacobians[w.episode][(w.start + torch.arange(w.length)) // self.stride] for w in windows]
        return torch.stack(rows).to(self.device)


def has_cpu_bf16() -> bool:
    """Whether the CPU has bfloat16 matrix products; without them bfloat16 is slower than float32."""
    return bool(torch.cpu._is_avx512_bf16_supported())
