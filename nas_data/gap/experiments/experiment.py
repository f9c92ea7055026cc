"""Choice of the experiment that separates an explanation best from its rivals."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from nas_data.command_file import write_commands
from nas_data.effects.base import Effect
from nas_data.errors import OptionError
from nas_data.gap.episode_batch import EpisodeBatch
from nas_data.gap.experiments.command_limits import CommandRange
from nas_data.gap.experiments.discrimination import Explanation, compute_separations, find_differing_joints, make_batch
from nas_data.gap.experiments.library import STEPS, ExperimentDesign, generate_experiments
from nas_data.gap.nominal import Nominal
from nas_data.gap.report_parts import TriedExperiment

__all__ = ["Explanation", "NextExperiment", "RatedExperiment", "choose_next_experiment", "write_experiment"]

SHOWN = 2  # most effects that are listed of each rival
MIN_SEPARATION = 1.0  # noise floors; smallest difference of rivals that is worth recording


@dataclass(frozen=True)
class RatedExperiment:
    """An experiment with the differences of an explanation from its rivals in it.

    Attributes:
        trial: Experiment.
        separations: Largest RMS difference from each rival over the noise floor of a joint.
        joints: That joint, for each rival.
        seconds: Duration [s].
    """

    trial: ExperimentDesign
    separations: tuple[float, ...]
    joints: tuple[str, ...]
    seconds: float

    @property
    def information(self) -> float:
        """What an observation says for the explanation and against its rivals, ½ Σ log(1 + separation²) [nats]."""
        return float(0.5 * np.log1p(np.square(self.separations)).sum())

    @property
    def separation(self) -> float:
        """Separation from the rival that differs most."""
        return max(self.separations)

    @property
    def joint(self) -> str:
        """Joint in which that rival differs most."""
        return self.joints[self.separations.index(self.separation)]

    def describe(self) -> TriedExperiment:
        """Return the experiment as the report lists it."""
        trial = self.trial
        return TriedExperiment(
            name=trial.name,
            on=trial.moved,
            seconds=self.seconds,
            separation=self.separation,
            joint=self.joint,
            separations=self.separations,
        )


@dataclass(frozen=True)
class NextExperiment:
    """Proposed experiment.

    Attributes:
        text: Description in one sentence.
        names: Columns of its command file: `<joint>.pos` [rad], `.vel` [rad/s] or `.effort` [N·m].
        commands: Commands from the rest pose with a slow approach, shape (T, n): of the first experiment of the table,
            or of steps of all joints if that does not decide.
        period: Control period [s].
        table: All experiments, most informative first.
    """

    text: str
    names: tuple[str, ...]
    commands: np.ndarray
    period: float
    table: tuple[RatedExperiment, ...]

    @property
    def decides(self) -> bool:
        """Whether a rival differs by more than noise in the best experiment."""
        return self.table[0].separation >= MIN_SEPARATION


def choose_next_experiment(
    nominal: Nominal,
    evidence: EpisodeBatch,
    leader: Explanation,
    rivals: Sequence[Explanation],
    floor: np.ndarray,
    seed: int,
) -> NextExperiment:
    """Choose the experiment to record next.

    Args:
        nominal: Given model.
        evidence: Recorded episodes.
        leader: Explanation of the data.
        rivals: Others that the data hardly distinguish from it, at least one.
        floor: Noise floor of each joint [rad; m], shape (n,).
        seed: Seed of random excitations.

    Raises:
        ModelFileError: a rival diverges.
        OptionError: the model takes torques without limits, or every experiment would harm the arm.
    """
    room = CommandRange.of(nominal, evidence)
    differing = [find_differing_joints((leader, rival), nominal.joints) for rival in rivals]
    concerned = tuple(joint for joint in nominal.joints if any(joint in joints for joints in differing))
    trials = list(generate_experiments(nominal, leader, room, concerned, seed))
    if not trials:
        raise OptionError("in each the arm would touch something or move more than twice as fast as recorded")
    batch = make_batch(nominal, [trial.commands for trial in trials], room.pose)
    apart = np.stack(
        [
            compute_separations(nominal, (leader, rival), evidence, batch, floor, joints)
            for rival, joints in zip(rivals, differing, strict=True)
        ],
        axis=1,
    )
    rows = [
        RatedExperiment(
            trial,
            tuple(own.max(axis=1).tolist()),
            tuple(nominal.joints[joint] for joint in own.argmax(axis=1)),
            len(trial.commands) * nominal.period,
        )
        for trial, own in zip(trials, apart, strict=True)
    ]
    table = tuple(sorted(rows, key=lambda row: -row.information))
    names = tuple(joint + kind for joint, kind in zip(nominal.joints, nominal.simulator().kinds, strict=True))
    text = describe_experiment(table[0], leader, rivals, nominal.joints)
    found = NextExperiment(text, names, table[0].trial.commands, nominal.period, table)
    return found if found.decides else replace(found, commands=choose_varied(table, nominal.joints).trial.commands)


def choose_varied(table: Sequence[RatedExperiment], joints: Sequence[str]) -> RatedExperiment:
    """Return the steps of all joints, which narrow the model's own parameters; the first experiment without them."""
    steps = (row for row in table if row.trial.name == STEPS and set(row.trial.moved) == set(joints))
    return next(steps, table[0])


def describe_experiment(
    best: RatedExperiment, leader: Explanation, rivals: Sequence[Explanation], joints: Sequence[str]
) -> str:
    """Describe the best experiment, what it separates, and what not."""
    pairs = [f"{describe_difference(leader, rival)} from {describe_difference(rival, leader)}" for rival in rivals]
    order = sorted(range(len(pairs)), key=lambda number: -best.separations[number])
    first, *others = order
    if best.separation < MIN_SEPARATION:
        every = " or ".join(pairs[number] for number in order)
        return (
            f"no simulated experiment separates {every}: at best, in {best.trial.name}, the two models would "
            "differ by "
            f"{best.separation:.1f} times the noise; a finer sensor or more load is needed, or varied motion, which "
            "narrows the model's own parameters"
        )
    place = "all joints" if len(best.trial.moved) == len(joints) > 1 else " and ".join(best.trial.moved)
    where = "there" if best.trial.moved == (best.joint,) else f"at {best.joint}"
    text = (
        f"{best.trial.name} on {place}: separates {pairs[first]}; the two models would differ by "
        f"{best.separation:.1f} times the noise {where}"
    )
    for number in others:
        apart = best.separations[number]
        text += f"; also {pairs[number]} ({apart:.1f})" if apart >= MIN_SEPARATION else f"; not {pairs[number]}"
    return text


def describe_difference(rival: Explanation, other: Explanation) -> str:
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
