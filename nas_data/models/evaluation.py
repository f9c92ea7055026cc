"""One-step and open-loop errors of a learned model and of the baselines hold, source and command."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from nas_data.count_of import count_of
from nas_data.dataset.dataset import Dataset
from nas_data.joint_units import find_joint_unit
from nas_data.metrics import Errors, format_error_table
from nas_data.models.hold_drift import HoldDrift
from nas_data.models.lstm import DynamicsModel
from nas_data.models.predictions import MODEL, NO_SIMULATORS, Predictions, predict
from nas_data.models.regimes import RegimeErrors
from nas_data.simulators.base import Simulator
from nas_data.text_table import align_columns

PLAIN = "plain fit"
LEGEND = {
    "model": "the model that is evaluated",
    "source": "the model as given, or as kept with the checkpoint or dataset",
    "hold": "predicts that nothing moves",
    "command": "predicts that every joint is where it is told to be; joints that take no positions hold",
}
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

    @classmethod
    def of(cls, dataset: Dataset, predictions: Predictions, with_holds: bool = False) -> "Evaluation":
        """Compare predictions with the measurements.

        Args:
            dataset: The episodes.
            predictions: Predictions for them.
            with_holds: Whether to measure the drift while commands are constant.
        """
        measured = [dataset.next_states[rows] for rows in dataset.episodes()]
        one_step, open_loop = (
            {name: Errors.of(dataset.joints, predicted, measured, dataset.slides) for name, predicted in mode.items()}
            for mode in (predictions.one_step, predictions.rollouts)
        )
        rollouts = predictions.rollouts
        diverged = {name: find_divergences(predicted, dataset.fps) for name, predicted in rollouts.items()}
        return cls(
            one_step,
            open_loop,
            rollouts,
            {name: times for name, times in diverged.items() if times},
            regimes=compare_regimes(dataset, rollouts),
            holding=measure_hold_drift(dataset, rollouts) if with_holds else None,
            numbers=dataset.numbers,
        )

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
            "notes": list(self.notes),
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


def evaluate(
    dataset: Dataset,
    simulator: Simulator | None,
    model: DynamicsModel | None,
    progress: Callable[[int, int], None] = lambda done, total: None,
    others: Mapping[str, Simulator] = NO_SIMULATORS,
) -> Evaluation:
    """Compare predictors with measurements; arguments and errors as of `predict`."""
    predictions = predict(dataset, simulator, model, progress, others)
    return Evaluation.of(dataset, predictions, with_holds=model is not None)


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
