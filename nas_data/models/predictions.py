"""One-step and open-loop predictions of a learned model, of sources, and of the baselines hold and command."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from operator import itemgetter

import numpy as np
import torch

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import ACTION
from nas_data.errors import JointMismatch
from nas_data.models.augmented import LearnedStepper
from nas_data.models.episodes import pad, read_episodes
from nas_data.models.lstm import DynamicsModel
from nas_data.models.threads import one_thread
from nas_data.open_loop import make_batches, pad_commands, roll_out_source
from nas_data.pairing import pair, read_initial_states
from nas_data.runs.progress import begin
from nas_data.simulators.base import Simulator, Stepper

MODEL = {"delta": "source + φ", "forward": "ψ"}
NO_SIMULATORS: Mapping[str, Simulator] = {}


@dataclass(frozen=True)
class Predictions:
    """Predictions of every predictor for the same episodes: by name, one array (T, 2n) or (T, n) per episode.

    Attributes:
        one_step: From measured states.
        rollouts: In open loop, from the first measured state.
    """

    one_step: dict[str, list[np.ndarray]]
    rollouts: dict[str, list[np.ndarray]]

    @classmethod
    def join(cls, parts: Sequence["Predictions"], places: Sequence[Sequence[int]]) -> "Predictions":
        """Return predictions of groups of episodes as one.

        Args:
            parts: Predictions of each group.
            places: Places of its episodes in the result.
        """

        def sort(name: str, mode: str) -> list[np.ndarray]:
            predicted = chain.from_iterable(getattr(part, mode)[name] for part in parts)
            pairs = zip(chain.from_iterable(places), predicted, strict=True)
            return [states for _, states in sorted(pairs, key=itemgetter(0))]

        modes = ({name: sort(name, mode) for name in getattr(parts[0], mode)} for mode in ("one_step", "rollouts"))
        return cls(*modes)


@one_thread()
def predict(
    dataset: Dataset,
    simulator: Simulator | None,
    model: DynamicsModel | None,
    progress: Callable[[int, int], None] = lambda done, total: None,
    others: Mapping[str, Simulator] = NO_SIMULATORS,
) -> Predictions:
    """Predict one step and in open loop.

    Args:
        dataset: Transitions, paired or not.
        simulator: Source; may be None for ψ and the trivial baselines.
        model: Frozen φ (needs the simulator) or ψ; None for the baselines alone.
        progress: Called with the numbers of completed and of all control steps.
        others: Further sources by name.

    Raises:
        JointMismatch: dataset, simulator and model do not fit together.
    """
    begin("simulating the source")
    if simulator is not None:
        dataset = pair(dataset, simulator)
    one_step, rollouts = predict_baselines(dataset, simulator)
    for name, other in others.items():
        begin(f"simulating the {name}")
        predicted = pair(dataset, other).sim_states
        one_step = {name: [predicted[rows] for rows in dataset.episodes()]} | one_step
        rollouts = {name: roll_out_source(dataset, other)} | rollouts
    if model is not None:
        name = MODEL[model.kind]
        begin(f"predicting with {name}")
        one_step = {name: predict_one_step(dataset, model, simulator)} | one_step
        rollouts = {name: roll_out_model(dataset, simulator, model, progress)} | rollouts
    return Predictions(one_step, rollouts)


def predict_baselines(
    dataset: Dataset, simulator: Simulator | None
) -> tuple[dict[str, list[np.ndarray]], dict[str, list[np.ndarray]]]:
    """Return one-step and open-loop predictions of source, hold and command: lists of (T, 2n) or (T, n) by name."""
    rows = list(dataset.episodes())
    one_step: dict[str, list[np.ndarray]] = {}
    rollouts: dict[str, list[np.ndarray]] = {}
    if simulator is not None:
        one_step["source"] = [dataset.sim_states[row] for row in rows]
        rollouts["source"] = roll_out_source(dataset, simulator)
    one_step["hold"] = [dataset.states[row] for row in rows]
    rollouts["hold"] = [np.repeat(dataset.states[row.start][None], row.stop - row.start, axis=0) for row in rows]
    if dataset.positional.any():
        n = len(dataset.joints)

        def command(row: slice, others: np.ndarray) -> np.ndarray:
            return np.where(dataset.positional, dataset.commands[row], others[..., :n])

        one_step["command"] = [command(row, dataset.states[row]) for row in rows]
        rollouts["command"] = [command(row, dataset.states[row.start]) for row in rows]
    return one_step, rollouts


def predict_one_step(dataset: Dataset, model: DynamicsModel, simulator: Simulator | None) -> list[np.ndarray]:
    """Predict each next state from the measured one, with the memory of the episode; a list of (T, 2n)."""
    changes = compute_changes(dataset, model)
    if model.corrects == "command":
        assert simulator is not None
        corrected = dataset.with_column(ACTION, dataset.features[ACTION], dataset.commands + np.concatenate(changes))
        dataset = pair(corrected, simulator)
        return [dataset.sim_states[rows] for rows in dataset.episodes()]
    base = dataset.sim_states if model.kind == "delta" else dataset.states
    return [base[rows] + change for rows, change in zip(dataset.episodes(), changes, strict=True)]


def compute_changes(dataset: Dataset, model: DynamicsModel) -> list[np.ndarray]:
    """Return the model's correction at each measured transition; a list of (T, 2n), or (T, n) for commands."""
    result: list[np.ndarray] = []
    for batch in make_batches(dataset.lengths, ordered=False):
        episodes = read_episodes(dataset, batch)
        padded, _ = pad(episodes)
        with torch.no_grad():
            changes, _ = model.changes(padded.states, padded.commands, padded.predicted)
        result += [changes[row, : len(episode)].numpy() for row, episode in enumerate(episodes)]
    return result


@one_thread()
def roll_out_model(
    dataset: Dataset,
    simulator: Simulator | None,
    model: DynamicsModel,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> list[np.ndarray]:
    """Roll the model out in open loop over every episode; a list of (T, 2n).

    Raises:
        JointMismatch: φ without a simulator, or joints that differ.
    """
    if simulator is None and model.kind == "delta":
        raise JointMismatch("A delta model corrects a simulator; give the source that it was trained with.")
    plan = make_batches(dataset.lengths)
    total, done = sum(int(dataset.lengths[batch].max()) for batch in plan), 0
    initial = read_initial_states(dataset, simulator)
    result: list[np.ndarray] = [np.empty(0)] * dataset.n_episodes
    for batch in plan:
        source = simulator.stepper(len(batch)) if simulator is not None else StaticStepper(dataset.joints, len(batch))
        stepper = LearnedStepper(source, model)
        stepper.reset(initial[batch])
        commands = pad_commands(dataset, batch)
        states = np.empty((len(batch), commands.shape[1], dataset.states.shape[1]))
        for step in range(commands.shape[1]):
            states[:, step] = stepper.step(commands[:, step])
            done += 1
            if step % 100 == 0 or done == total:
                progress(done, total)
        for row, episode in enumerate(batch):
            result[episode] = states[row, : dataset.lengths[episode]]
    return result


class StaticStepper(Stepper):
    """Joints without dynamics, which stay where they are set: sufficient as a source for ψ."""

    def __init__(self, joints: tuple[str, ...], size: int) -> None:
        """Create `size` simulations at zero."""
        self.joints = joints
        self.size = size
        self._states: np.ndarray = np.zeros((size, 2 * len(joints)))

    @property
    def states(self) -> np.ndarray:
        """Positions [rad] then velocities [rad/s], shape (B, 2n)."""
        return self._states

    @property
    def objects(self) -> np.ndarray:
        """No objects, shape (B, 0)."""
        return np.zeros((self.size, 0))

    def command_objects(self, targets: np.ndarray, rows: np.ndarray) -> None:
        """Do nothing: there are no objects."""

    def reset(self, states: np.ndarray, rows: np.ndarray | None = None) -> None:
        """Set the states of some simulations."""
        self._states[slice(None) if rows is None else rows] = states

    def step(self, commands: np.ndarray) -> np.ndarray:
        """Return the unchanged states."""
        return self._states

    def set_states(self, states: np.ndarray) -> None:
        """Set all states."""
        self._states = np.array(states, dtype=float)

    def site_positions(self, name: str) -> np.ndarray:
        """Refuse: there are no bodies.

        Raises:
            LookupError: always.
        """
        raise LookupError(f"joints without a model have no site '{name}'")
