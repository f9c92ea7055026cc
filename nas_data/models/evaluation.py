"""One-step and open-loop errors of a learned model and of the baselines hold, source and command."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import torch

from nas_data.count_of import count_of
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import ACTION
from nas_data.errors import JointMismatch
from nas_data.joint_units import find_joint_unit
from nas_data.metrics import Errors, format_error_table
from nas_data.models.augmented import LearnedStepper
from nas_data.models.episodes import pad, read_episodes
from nas_data.models.hold_drift import HoldDrift
from nas_data.models.lstm import DynamicsModel
from nas_data.models.regimes import RegimeErrors
from nas_data.models.threads import one_thread
from nas_data.open_loop import make_batches, pad_commands, roll_out_source
from nas_data.pairing import pair, read_initial_states
from nas_data.runs.progress import begin
from nas_data.simulators.base import Simulator, Stepper
from nas_data.text_table import align_columns

MODEL = {"delta": "source + φ", "forward": "ψ"}
PLAIN = "plain fit"
LEGEND = {
    "model": "the model that is evaluated",
    "source": "the model as given, or as kept with the checkpoint or dataset",
    "hold": "predicts that nothing moves",
    "command": "predicts that every joint is where it is told to be; joints that take no positions hold",
}
NO_SIMULATORS: Mapping[str, Simulator] = {}
EPISODES_SHOWN = 50
DIVERGED_SHOWN = 5  # most diverged episodes listed in the text; the JSON lists all


@dataclass(frozen=True, repr=False)
class Evaluation:
    """Errors of every predictor on the same episodes.

    Attributes:
        one_step: One-step errors from measured states, by predictor.
        open_loop: Open-loop errors from the first measured state of each episode, by predictor.
        rollouts: Open-loop states of each episode, shape (T, 2n), by predictor.
        diverged: Time of divergence [s after the start] by place of the episode in `rollouts`, by predictor.
        notes: Further sentences on predictors.
        regimes: Open-loop errors of source and source + φ by regime of the motion; None without φ.
        holding: Drift in open loop while commands are constant; None without such holds.
        numbers: Number of each episode in its recording, for text and JSON; empty for all of the recording.
    """

    one_step: dict[str, Errors]
    open_loop: dict[str, Errors]
    rollouts: dict[str, list[np.ndarray]]
    diverged: dict[str, dict[int, float]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    regimes: RegimeErrors | None = None
    holding: HoldDrift | None = None
    numbers: tuple[int, ...] = ()

    @property
    def episode_numbers(self) -> tuple[int, ...]:
        """Number of each episode in its recording."""
        return self.numbers or tuple(range(len(next(iter(self.open_loop.values())).lengths)))

    def __repr__(self) -> str:
        """Return the open-loop error of each predictor in one line."""
        errors = ", ".join(f"{name} {one.overall:.3g}" for name, one in self.open_loop.items())
        first = next(iter(self.open_loop.values()))
        return f"Evaluation({count_of(len(first.lengths), 'episode')}, open loop [{first.unit.si}]: {errors})"

    def __str__(self) -> str:
        """Return both tables."""
        return self.text()

    def text(self) -> str:
        """Return both tables, followed by divergences, notes and the tables of regimes and holds."""
        steps = format_error_table(self.one_step, "One step: RMSE of the next position")
        loop = format_error_table(self.open_loop, "Open loop: RMSE of positions, started once per episode")
        divergences = [describe_divergence(name, times, self.episode_numbers) for name, times in self.diverged.items()]
        legend = [f"  {name}: {means}" for name, means in LEGEND.items() if name in self.open_loop]
        more = [f"\n{part.text()}" for part in (self.regimes, self.holding) if part]
        return "\n".join([f"{steps}\n\n{loop}", *legend, *divergences, *self.notes, *more])

    def episodes_text(self) -> str:
        """Return a table of the open-loop errors by episode and predictor, for the first kind of joints."""
        names = list(self.open_loop)
        unit, *others = (unit for unit, _ in self.open_loop[names[0]].kinds)
        rows = list(zip(*(unit.factor * np.array(self.open_loop[name].per_episode) for name in names), strict=True))
        kind = f" of the {unit.kind}" if others else ""
        numbered = list(zip(self.episode_numbers, rows, strict=True))
        cells = [[f"{number:7d}", *map(format_error, row)] for number, row in numbered[:EPISODES_SHOWN]]
        lines = align_columns([["episode", *names], *cells], least=11)
        more = ["…"] if len(rows) > EPISODES_SHOWN else []
        return "\n  ".join([f"Open loop, each episode{kind} [{unit.shown}]", *lines, *more])

    def to_json(self) -> dict[str, object]:
        """Return the errors [rad; m for slides] for the JSON report."""
        one = next(iter(self.open_loop.values()))
        return {
            "unit": one.unit.si,
            "units": {joint: find_joint_unit(joint, one.slides).si for joint in one.joints},
            "episodes": list(self.episode_numbers),
            "one_step": {name: errors.to_json() for name, errors in self.one_step.items()},
            "open_loop": {name: errors.to_json() for name, errors in self.open_loop.items()},
            "diverged": {
                name: [{"episode": self.episode_numbers[place], "after_s": seconds} for place, seconds in times.items()]
                for name, times in self.diverged.items()
            },
            "regimes": self.regimes.to_json() if self.regimes else None,
            "holding": self.holding.to_json() if self.holding else None,
        }


def describe_divergence(name: str, times: Mapping[int, float], numbers: Sequence[int]) -> str:
    """Return a sentence on the episodes in which a learned model diverges, and when.

    Args:
        name: Name of the model.
        times: Time of divergence [s after the start] by place of the episode.
        numbers: Number of each episode in its recording.
    """
    entries = [f"episode {numbers[place]} after {seconds:.2f} s" for place, seconds in times.items()]
    more = [f"and {len(entries) - DIVERGED_SHOWN} more"] if len(entries) > DIVERGED_SHOWN else []
    subject = "φ, not the source," if name == MODEL["delta"] else name
    return (
        f"{name} diverges in {len(times)} of {count_of(len(numbers), 'episode')} "
        f"({', '.join([*entries[:DIVERGED_SHOWN], *more])}): "
        f"{subject} leaves all bounds; train it longer or on more data."
    )


def format_error(value: float) -> str:
    """Return an error as a cell of the table of episodes."""
    return f"{value:.3f}" if np.isfinite(value) else "diverged"


@one_thread()
def evaluate(
    dataset: Dataset,
    simulator: Simulator | None,
    model: DynamicsModel | None,
    progress: Callable[[int, int], None] = lambda done, total: None,
    others: Mapping[str, Simulator] = NO_SIMULATORS,
) -> Evaluation:
    """Compare predictors with measurements.

    Args:
        dataset: Transitions, paired or not.
        simulator: Source; may be None for ψ and the trivial baselines.
        model: Frozen φ (needs the simulator) or ψ; None for the baselines alone.
        progress: Called with the numbers of completed and of all control steps.
        others: Further sources by name.

    Raises:
        JointMismatch: dataset, simulator and model do not fit together.
    """
    measured = [dataset.next_states[rows] for rows in dataset.episodes()]
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
    joints = dataset.joints
    return Evaluation(
        {name: Errors.of(joints, predicted, measured, dataset.slides) for name, predicted in one_step.items()},
        {name: Errors.of(joints, predicted, measured, dataset.slides) for name, predicted in rollouts.items()},
        rollouts,
        {name: times for name, predicted in rollouts.items() if (times := find_divergences(predicted, dataset.fps))},
        regimes=compare_regimes(dataset, rollouts),
        holding=measure_hold_drift(dataset, rollouts) if model is not None else None,
        numbers=dataset.numbers,
    )


def compare_regimes(dataset: Dataset, rollouts: Mapping[str, list[np.ndarray]]) -> RegimeErrors | None:
    """Return the errors of source and source + φ by regime; None if one of them was not rolled out."""
    names = ("source", MODEL["delta"])
    return RegimeErrors.of(dataset, *(rollouts[name] for name in names)) if set(names) <= set(rollouts) else None


def measure_hold_drift(dataset: Dataset, rollouts: Mapping[str, list[np.ndarray]]) -> HoldDrift | None:
    """Return the drift of rollouts while commands are constant; None without such holds, or for torques."""
    drift = HoldDrift.of(dataset, rollouts) if dataset.commands_positions else None
    return drift if drift is not None and drift.holds.any() else None


def find_divergences(rollouts: Sequence[np.ndarray], rate: float) -> dict[int, float]:
    """Return, by episode, the time [s] at which a rollout (T, 2n) is first not finite; the control rate is in Hz."""
    finite = [np.isfinite(states).all(axis=1) for states in rollouts]
    return {episode: float(np.argmin(row) + 1) / rate for episode, row in enumerate(finite) if not row.all()}


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
