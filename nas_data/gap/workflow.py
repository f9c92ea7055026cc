"""Find, name, add, show: the whole workflow from a dataset and a model to a report."""

import shutil
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.read import read
from nas_data.dataset.transitions import as_transitions
from nas_data.dataset.versions import resolve
from nas_data.errors import DatasetInvalid, NasError
from nas_data.gap.add import write_effects, write_model
from nas_data.gap.evidence import Evidence, divide, windows
from nas_data.gap.experiments.experiment import Rival, next_experiment, write
from nas_data.gap.finding.driven import until_driven_again
from nas_data.gap.finding.find import Found, find
from nas_data.gap.floor import noise_floor
from nas_data.gap.gains import with_relative_gains
from nas_data.gap.name import Naming, name
from nas_data.gap.nominal import Nominal, with_timestep
from nas_data.gap.report import Outcome, write_report, write_series
from nas_data.gap.search.final import Final, finish
from nas_data.gap.search.fit import Task
from nas_data.gap.search.scales import scales
from nas_data.gap.showing.show import show
from nas_data.simulators.settled import Hold

EXPERIMENT = "next_experiment.csv"
TRAIN_STEPS = 120_000  # physics steps that one rollout of all training episodes may take, half a second of work
HELD_STEPS = 60_000  # the same for the held-out episodes

Say = Callable[[str], None]


def silent(text: str) -> None:
    """Say nothing."""


@dataclass(frozen=True)
class Problem:
    """What the workflow is given, ready to work on.

    Attributes:
        dataset: Transitions, as recorded.
        evidence: Its episodes.
        train: Model and episodes that are fitted.
        held: Model and episodes that judge.
        names: How report and page call dataset and model.
        given: The model as handed over.
    """

    dataset: Dataset
    evidence: Evidence
    train: Task
    held: Task
    names: tuple[str, str]
    given: str | Path

    @classmethod
    def load(cls, dataset: str | Path, model: str | Path) -> "Problem":
        """Read both files.

        Raises:
            NasError: one of them cannot be used; the sentence names it.
        """
        root = resolve(Path(dataset))
        recorded, _ = as_transitions(read(root))
        return cls.of(recorded, model, root)

    @classmethod
    def of(cls, recorded: Dataset, model: str | Path, root: Path, moving: bool = False) -> "Problem":
        """Prepare transitions.

        Args:
            recorded: Transitions with 2n-states.
            model: A robot's name or a model file.
            root: Folder of the dataset that they are from, for names and errors.
            moving: Whether the episodes were cut out of motions; otherwise they start at rest.

        Raises:
            NasError: one of the two cannot be used; the sentence names it.
        """
        transitions = with_relative_gains(recorded, model, root)
        evidence = Evidence.of(until_driven_again(transitions), moving)
        if len(evidence) < 2:
            raise DatasetInvalid(
                f"{root} has {len(evidence)} episode; at least two are needed, one to fit and one to judge by: "
                "record more, or cut it with 'nas split'."
            )
        nominal = Nominal.load(model, evidence)
        floor = noise_floor(evidence)
        train, held = divide(evidence)
        substeps = nominal.simulator().substeps
        train, held = windows(train, TRAIN_STEPS // substeps), windows(held, HELD_STEPS // substeps)
        names = (root.parent.name if root.name.startswith("v") else root.name, Path(model).name)
        return cls(transitions, evidence, Task(nominal, train, floor), Task(nominal, held, floor), names, model)


def investigate(
    dataset: str | Path, model: str | Path, out: str | Path, say: Say = silent, learn: int = 0
) -> dict[str, object]:
    """Run the whole workflow.

    Args:
        dataset: Folder of a dataset.
        model: A robot's name or a model file.
        out: Folder of the report; files of an earlier report in it are replaced.
        say: Told what is going on.
        learn: Updates in which φ learns what the names leave; 0 leaves it out.

    Returns:
        The content of `report.json`.

    Raises:
        NasError: the dataset or the model cannot be used.
    """
    began = time.monotonic()
    problem = Problem.load(dataset, model)
    folder = Path(out)
    folder.mkdir(parents=True, exist_ok=True)
    clear(folder)
    say("find: where model and recording disagree")
    found = find(problem.dataset, problem.evidence, problem.train.nominal, problem.train.floor)
    return conclude(problem, found, folder, began, say, learn)


def conclude(problem: Problem, found: Found, folder: Path, began: float, say: Say, learn: int) -> dict[str, object]:
    """Name, add, score from the written file and report."""
    if found.undecidable:
        say("; ".join(found.undecidable))
    say("name: which effect is missing")
    naming = name(problem.train, problem.held, say)
    say("add: write the model with the effects")
    outcome = added(problem, naming.final, naming.null, folder)
    if learn:
        say("learn: φ on what the names leave")
        outcome = replace(outcome, learned=learned(problem, outcome.model, learn, say))
    experiment = proposed(problem, naming, folder)
    report = write_report(folder, problem, found, naming, outcome, experiment, time.monotonic() - began)
    write_series(folder, problem, naming, outcome)
    say("show: draw it")
    show(folder)
    return report


def learned(problem: Problem, model: Path, updates: int, say: Say) -> Mapping[str, float]:
    """Train φ on top of the written model; torch is loaded for nothing else."""
    from nas_data.gap.learned import learned_shares

    numbers = [sorted({int(number) for number in task.evidence.numbers}) for task in (problem.train, problem.held)]
    return learned_shares(problem.dataset, (problem.given, model), (numbers[0], numbers[1]), model.parent, updates, say)


def proposed(problem: Problem, naming: Naming, folder: Path) -> Mapping[str, object]:
    """Write the command file that would settle the most doubtful name.

    Returns:
        `next_experiment`, what it is, None where all names are sure; and `experiments`, all that were compared.
    """
    rival = naming.doubt
    if rival is None:
        return {"next_experiment": None, "experiments": []}
    pair = (
        Rival(naming.final.effects, dict(naming.final.factors)),
        Rival(rival.effects, rival.fit.factors),
    )
    try:
        experiment = next_experiment(problem.train.nominal, pair, problem.train.floor, seed=0)
    except NasError as error:
        return {"next_experiment": f"none could be computed: {error}", "experiments": []}
    write(experiment, folder / EXPERIMENT)
    return {"next_experiment": f"{experiment.text} (commands in {EXPERIMENT})", "experiments": experiment.to_json()}


def added(problem: Problem, final: Final, null: Final, folder: Path) -> Outcome:
    """Write the model and judge it by what the written file does on held-out episodes.

    Where an effect is beyond MJCF, the file holds the nearest one that is not, fitted in its place; the error after
    is then that of the effects named, which `effects.json` holds, and the file's own is told beside it.
    """
    task = problem.train.begun(final.effects, dict(final.factors)).corrected(final.effects, dict(final.factors))
    hold = usual_hold(task, final)
    nominal, held = problem.held.nominal, problem.held.evidence.begun(hold)
    effects, factors = final.effects, dict(final.factors)
    native = stand_ins(problem, final)
    model, _ = write_model(folder, nominal, native.effects, dict(native.factors), task.timestep)
    write_effects(folder, effects, factors)
    written = Nominal.load(model, held).predict(held)
    after = written
    if native is not final:
        after = with_timestep(nominal, task.timestep).predict(held, effects, factors)
    return Outcome(
        before=nominal.predict(held),
        retuned=nominal.predict(held, (), null.factors),
        after=after,
        written=written,
        model=model,
    )


def usual_hold(task: Task, final: Final) -> Hold:
    """Return whether the weight or nothing loads a model best at the start of all episodes alike."""
    effects, factors = final.effects, dict(final.factors)
    if not task.nominal.simulator(effects, factors).remembers:
        return Hold.WEIGHT

    def misfit(hold: Hold) -> float:
        predicted = task.nominal.predict(task.evidence.begun(hold), effects, factors)
        return task.misfit(predicted + task.correction)

    return min((Hold.WEIGHT, Hold.NOTHING), key=misfit)


def stand_ins(problem: Problem, final: Final) -> Final:
    """Return a hypothesis that a model file can express: the same one, or one with the nearest effects, fitted."""
    if all(effect.in_model for effect in final.effects):
        return final
    train = problem.train
    sizes = scales(train.nominal, train.evidence, train.nominal.predict(train.evidence))
    by_joint = dict(zip(train.nominal.joints, sizes, strict=True))
    near = [effect if effect.joint is None else effect.native(by_joint[effect.joint]) for effect in final.effects]
    return finish(train, [effect for effect in near if effect is not None], dict(final.factors), rounds=1)


def clear(folder: Path) -> None:
    """Remove what an earlier report left."""
    for item in ("report.json", "report.html", "effects.json", "model.xml", "series.npz", EXPERIMENT):
        (folder / item).unlink(missing_ok=True)
    shutil.rmtree(folder / "figures", ignore_errors=True)
