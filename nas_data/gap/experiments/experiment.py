"""Choice of the experiment in which two rival explanations differ most."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from nas_data.command_file import write_commands
from nas_data.effects.base import Effect
from nas_data.errors import OptionError
from nas_data.gap.episode_batch import EpisodeBatch
from nas_data.gap.experiments.command_limits import CommandRange
from nas_data.gap.experiments.discrimination import Rival, compute_separations, find_differing_joints, make_batch
from nas_data.gap.experiments.library import ExperimentDesign, generate_experiments
from nas_data.gap.nominal import Nominal
from nas_data.gap.report_parts import TriedExperiment

__all__ = ["NextExperiment", "RatedExperiment", "Rival", "choose_next_experiment", "write_experiment"]

SHOWN = 2  # most effects that are listed of each rival
MIN_SEPARATION = 1.0  # noise floors; smallest difference of rivals that is worth recording


@dataclass(frozen=True)
class RatedExperiment:
    """An experiment with the difference of two rivals in it.

    Attributes:
        trial: Experiment.
        separation: Largest RMS difference of the rivals over the noise floor of a joint.
        joint: That joint.
        seconds: Duration [s].
    """

    trial: ExperimentDesign
    separation: float
    joint: str
    seconds: float

    def describe(self) -> TriedExperiment:
        """Return the experiment as the report lists it."""
        trial = self.trial
        return TriedExperiment(
            name=trial.name, on=trial.moved, seconds=self.seconds, separation=self.separation, joint=self.joint
        )


@dataclass(frozen=True)
class NextExperiment:
    """Proposed experiment.

    Attributes:
        text: Description in one sentence.
        names: Columns of its command file: `<joint>.pos` [rad], `.vel` [rad/s] or `.effort` [N·m].
        commands: Commands from the rest pose with a slow approach, shape (T, n).
        period: Control period [s].
        table: All experiments, largest separation first.
    """

    text: str
    names: tuple[str, ...]
    commands: np.ndarray
    period: float
    table: tuple[RatedExperiment, ...]

    @property
    def decides(self) -> bool:
        """Whether the rivals differ by more than noise in the best experiment."""
        return self.table[0].separation >= MIN_SEPARATION


def choose_next_experiment(
    nominal: Nominal, evidence: EpisodeBatch, rivals: tuple[Rival, Rival], floor: np.ndarray, seed: int
) -> NextExperiment:
    """Choose the experiment to record next.

    Args:
        nominal: Given model.
        evidence: Recorded episodes.
        rivals: Two explanations that the data cannot distinguish.
        floor: Noise floor of each joint [rad; m], shape (n,).
        seed: Seed of random excitations.

    Raises:
        ModelFileError: the second rival diverges.
        OptionError: the model takes torques without limits, or every experiment would harm the arm.
    """
    room = CommandRange.of(nominal, evidence)
    concerned = find_differing_joints(rivals, nominal.joints)
    trials = list(generate_experiments(nominal, rivals[0], room, concerned, seed))
    if not trials:
        raise OptionError("in each the arm would touch something or move more than twice as fast as recorded")
    batch = make_batch(nominal, [trial.commands for trial in trials], room.pose)
    apart = compute_separations(nominal, rivals, batch, floor, concerned)
    rows = [
        RatedExperiment(
            trial, float(row.max()), nominal.joints[int(row.argmax())], len(trial.commands) * nominal.period
        )
        for trial, row in zip(trials, apart, strict=True)
    ]
    table = tuple(sorted(rows, key=lambda row: -row.separation))
    names = tuple(joint + kind for joint, kind in zip(nominal.joints, nominal.simulator().kinds, strict=True))
    text = describe_experiment(table[0], rivals, nominal.joints)
    return NextExperiment(text, names, table[0].trial.commands, nominal.period, table)


def describe_experiment(best: RatedExperiment, rivals: tuple[Rival, Rival], joints: Sequence[str]) -> str:
    """Describe the best experiment and what it distinguishes."""
    one, two = (describe_difference(rival, other) for rival, other in (rivals, rivals[::-1]))
    if best.separation < MIN_SEPARATION:
        return (
            f"no simulated experiment separates {one} from {two}: at best, in {best.trial.name}, the two models would "
            "differ by "
            f"{best.separation:.1f} times the noise; a finer sensor or more load is needed"
        )
    place = "all joints" if len(best.trial.moved) == len(joints) > 1 else " and ".join(best.trial.moved)
    where = "there" if best.trial.moved == (best.joint,) else f"at {best.joint}"
    return (
        f"{best.trial.name} on {place}: separates {one} from {two}; the two models would differ by "
        f"{best.separation:.1f} times the noise {where}"
    )


def describe_difference(rival: Rival, other: Rival) -> str:
    """Return the effects of a rival that the other lacks, in words."""
    theirs = {(effect.name(), effect.joint) for effect in other.effects}
    own = [effect for effect in rival.effects if (effect.name(), effect.joint) not in theirs]
    counts = Counter(effect.name() for effect in (*rival.effects, *other.effects))
    words = [describe_effect(effect, counts[effect.name()] > 1) for effect in own]
    more = [f"{len(words) - SHOWN} more"] if len(words) > SHOWN else []
    return " and ".join([*words[:SHOWN], *more]) or "no further effect"


def describe_effect(effect: Effect, with_joint: bool) -> str:
    """Return an effect's name in words, with its joint if the name occurs several times."""
    words = effect.name().replace("_", " ")
    return f"{words} in {effect.joint or 'the whole arm'}" if with_joint else words


def write_experiment(experiment: NextExperiment, path: Path) -> None:
    """Write the commands as the CSV file that `nas record sim --commands` plays."""
    write_commands(path, experiment.names, [experiment.commands])
