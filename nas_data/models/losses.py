"""The two phases of training: teacher forcing on measured states, then free running on the model's own."""

from collections.abc import Collection, Sequence
from typing import NamedTuple, Protocol

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from nas_data.errors import DatasetInvalid
from nas_data.joint_units import mean_of_kind
from nas_data.models.divergence import predict_bounded
from nas_data.models.episodes import Episode, cut_episodes, join, pad
from nas_data.models.jacobians import jacobians
from nas_data.models.lstm import DynamicsModel, Memory
from nas_data.models.presets import TrainingOptions
from nas_data.models.stateful_source import follow, start_windows
from nas_data.simulators.base import Simulator, Stepper

SHORTEST = 20  # frames of the first free-running windows
MOST_JACOBIANS = 600_000  # along the data, half a gigabyte of a 7-joint arm; beyond, neighbours share one
BURN_IN = 100  # frames read before a window, so that it starts with a memory
VELOCITY_WEIGHT = 0.02  # of squared, normalised velocity errors beside position errors
FAR = 30.0  # spreads of positions or velocities off what was measured: a rollout that diverged
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
        self.segments = cut_episodes(episodes, options.segment)
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


class Place(NamedTuple):
    """Where a window lies: episode, first frame, frames."""

    episode: int
    start: int
    length: int


class Moment(NamedTuple):
    """What a batch of rollouts is about to do.

    Attributes:
        states: Positions [rad] then velocities [rad/s], shape (B, 2n).
        commands: Shape (B, n).
        objects: Measured states of the source's objects, shape (B, m).
        slope: Source's Jacobians, shape (B, 2n, 2n or 3n); None for ψ.
    """

    states: Tensor
    commands: Tensor
    objects: Tensor
    slope: Tensor | None


class FreeRunning:
    """Errors of rollouts on the model's own states, with the source in the loop; what a policy will live in.

    A window begins where an episode does, the memory empty, or later, after the model has read what was measured
    before. The gradient runs through the whole window, less at each step by the options' discount: through the
    network exactly, through the source by its Jacobian at the measured transition of the same time. A rollout that
    diverges, or that the source cannot follow, goes on along what was measured: from there on its error stays as it
    was, without a gradient.
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
        """Measure scales and the source's Jacobian.

        Args:
            model: φ or ψ.
            episodes: Training episodes.
            simulator: Source; needed for φ only.
            options: Windows, frames, learning rate, seed.
            device: Where the network lives.
            slides: Names of the joints that are slides; the errors of either kind are over the spread of that kind.

        Raises:
            DatasetInvalid: no episode is longer than one transition.
        """
        self.model = model
        self.episodes = [episode for episode in episodes if len(episode) > 1]
        if not self.episodes:
            raise DatasetInvalid("No training episode has two transitions; record longer ones, or give --updates 0.")
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
            self.jacobians = [self._along(self.simulator, episode) for episode in self.episodes]

    def _scale(self, spread: Tensor, slides: Collection[str]) -> Tensor:
        """Return for each joint the mean spread of the joints of its kind, shape (n,)."""
        means = mean_of_kind(spread.double().numpy(), self.model.joints, slides)
        return torch.from_numpy(means).float().clamp_min(1e-6).to(self.device)

    def _along(self, simulator: Simulator, episode: Episode) -> Tensor:
        """Return the source's Jacobian at every `stride`-th transition of an episode."""
        scenes = torch.cat([episode.states, episode.objects], dim=1)
        picked = (scenes, episode.commands, episode.predicted)
        states, commands, predicted = (x[:: self.stride].double().numpy() for x in picked)
        if simulator.remembers:
            predicted = simulator.predict(states, commands)[:, : predicted.shape[1]]
        return torch.from_numpy(
            jacobians(simulator, states, commands, predicted, of_commands=self.model.corrects == "command")
        ).float()

    def loss(self, update: int) -> Tensor:
        """Return the loss of one batch of windows: smooth absolute position errors, squared velocity errors."""
        places = self._draw(update)
        batch, _ = pad([self.episodes[p.episode].window(p.start, p.length) for p in places])
        slopes = self._slopes(places)
        states = batch.states[:, 0].to(self.device)
        commands = batch.commands.to(self.device)
        memory = self._memories(places)
        stepper = self._stepper(places)
        lost = torch.zeros(len(states), dtype=torch.bool, device=self.device)
        errors: list[Tensor] = []
        for step in range(commands.shape[1]):
            slope = None if slopes is None else slopes[:, step]
            now = Moment(states, commands[:, step], batch.objects[:, step], slope)
            states, refused, memory = self._step(now, stepper, memory)
            target = batch.targets[:, step].to(self.device)
            error = states - target
            states = scale_gradient(states, self.options.discount)
            lost = lost | refused.to(self.device) | self._far(error.detach())
            if lost.any():
                states = torch.where(lost[:, None], target, states)
                held = errors[-1].detach() if errors else torch.zeros_like(error)
                error = torch.where(lost[:, None], held, error)
            errors.append(error)
        n = len(self.model.joints)
        error = torch.stack(errors, dim=1)
        position = error[..., :n] / self.position_scale
        velocity = error[..., n:] / self.velocity_scale
        smooth = functional.smooth_l1_loss(position, torch.zeros_like(position), beta=3.0)
        return smooth + VELOCITY_WEIGHT * velocity.square().mean()

    def _step(self, now: "Moment", stepper: Stepper | None, memory: Memory) -> tuple[Tensor, Tensor, Memory]:
        """Return the model's next states, which rows the source refused, and the memory after them."""
        states, commands = now.states[:, None], now.commands[:, None]
        if self.model.corrects == "command":
            change, memory = self.model.changes(states, commands, states, memory)
            predicted, refused = self._predict(now._replace(commands=now.commands + change[:, 0]), stepper)
            return predicted, refused, memory
        predicted, refused = self._predict(now, stepper)
        corrected, memory = self.model.next_states(states, commands, predicted[:, None], memory)
        return corrected[:, 0], refused, memory

    def _far(self, error: Tensor) -> Tensor:
        """Return which rollouts are lost, shape (B,): what they do from here on would only drown the others."""
        n = len(self.model.joints)
        near = (error[:, :n].abs() < FAR * self.position_scale / POSITION_SCALE).all(dim=1)
        return ~(near & (error[:, n:].abs() < FAR * self.velocity_scale).all(dim=1))

    def _draw(self, update: int) -> list[Place]:
        """Draw windows of equal length, longer ones later; many begin where an episode does, as rollouts will."""
        rng = np.random.default_rng([self.options.seed, 2, update])
        grown = min(1.0, 2 * update / max(1, self.updates))
        length = int(min(SHORTEST, self.horizon) + grown * max(0, self.horizon - SHORTEST))
        long_enough = [index for index, episode in enumerate(self.episodes) if len(episode) >= length]
        weights = np.array([len(self.episodes[index]) for index in long_enough], dtype=float)
        chosen = rng.choice(long_enough, max(8, self.options.frames // length), p=weights / weights.sum())
        latest = np.array([len(self.episodes[index]) - length for index in chosen])
        starts = np.maximum(0, rng.integers(-length // 2, latest + 1))
        return [Place(int(index), int(start), length) for index, start in zip(chosen, starts, strict=True)]

    def _memories(self, places: Sequence[Place]) -> Memory:
        """Return what the model remembers at the windows' starts, after reading what was measured before them."""
        memory = self.model.no_memory(len(places))
        late = [row for row, place in enumerate(places) if place.start]
        if not late:
            return memory
        runs = [min(places[row].start, BURN_IN) for row in late]
        before = [
            self.episodes[places[row].episode].window(places[row].start - run, run)
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

    def _stepper(self, places: Sequence[Place]) -> Stepper | None:
        """Return the source at the windows' starts, where it has something to remember."""
        if self.simulator is None or not self.simulator.remembers:
            return None
        episodes, starts = [self.episodes[p.episode] for p in places], np.array([p.start for p in places])
        return start_windows(self.simulator, episodes, starts, BURN_IN)

    def _predict(self, moment: "Moment", stepper: Stepper | None = None) -> tuple[Tensor, Tensor]:
        """Return the source's next states, differentiable by its Jacobian, and which rows it refused.

        Objects are where they were measured; a source that remembers moves them itself. For ψ the next states are the
        states themselves.
        """
        states, commands, objects, slope = moment
        if self.simulator is None or slope is None:
            return states, torch.zeros(len(states), dtype=torch.bool)
        now, commanded = (x.detach().cpu().numpy().astype(np.float64) for x in (states, commands))
        if stepper is None:
            scenes = np.concatenate([now, objects.double().numpy()], axis=1)
            wide, refused = predict_bounded(self.simulator, scenes, commanded)
            exact = wide[:, : now.shape[1]]
        else:
            exact = follow(stepper, now, commanded)
            refused = ~np.isfinite(exact).all(axis=1)
            exact = np.where(refused[:, None], now, exact)
        moved = states if self.model.corrects == "state" else torch.cat([states, commands], dim=1)
        followed = (slope @ moved[:, :, None])[:, :, 0]
        predicted = followed + (torch.from_numpy(exact).float().to(self.device) - followed).detach()
        return predicted, torch.from_numpy(refused)

    def _slopes(self, places: Sequence[Place]) -> Tensor | None:
        """Return the source's Jacobians along the windows, shape (B, T, 2n, 2n), or (B, T, 2n, 3n) with commands'."""
        if self.jacobians is None:
            return None
        rows = [self.jacobians[p.episode][(p.start + torch.arange(p.length)) // self.stride] for p in places]
        return torch.stack(rows).to(self.device)


def scale_gradient(values: Tensor, factor: float) -> Tensor:
    """Return the same values, through which a share of their gradient passes back."""
    return torch.lerp(values.detach(), values, factor)


def processor_has_bf16() -> bool:
    """Whether bfloat16 matrix products run in hardware; elsewhere they are slower than float32."""
    return bool(torch.cpu._is_avx512_bf16_supported())
