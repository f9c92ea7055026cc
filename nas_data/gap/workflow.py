"""Find, name, add, show: the whole workflow from a dataset and a model to a report."""

import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

from nas_data.errors import NasError, OptionError
from nas_data.gap.added import added
from nas_data.gap.experiments.experiment import Rival, next_experiment, write
from nas_data.gap.finding.find import Found, find
from nas_data.gap.name import Naming, name
from nas_data.gap.place import check_place, clear
from nas_data.gap.portable import check_portable
from nas_data.gap.problem import Problem
from nas_data.gap.report import write_report, write_series
from nas_data.gap.showing.show import show

EXPERIMENT = "next_experiment.csv"

Say = Callable[[str], None]


def silent(text: str) -> None:
    """Say nothing."""


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
        OutputExists: the folder holds what no report wrote, and a report would replace.
        OptionError: the number of updates is negative.
    """
    began, folder = time.monotonic(), Path(out)
    if learn < 0:
        raise OptionError(f"--learn is {learn}; give 0, which leaves φ out, or a number of updates such as 400.")
    check_place(folder, model)
    problem = Problem.load(dataset, model)
    check_portable(problem.train.nominal.spec, problem.train.nominal.robot.mjcf)
    say("find: where model and recording disagree")
    found = find(problem.dataset, problem.evidence, problem.train.nominal, problem.train.floor)
    return conclude(problem, found, folder, began, say, learn)


def conclude(problem: Problem, found: Found, folder: Path, began: float, say: Say, learn: int) -> dict[str, object]:
    """Name, add, score from the written file and report."""
    if found.undecidable:
        say("; ".join(found.undecidable))
    say("name: which effect is missing")
    naming = name(problem.train, problem.held, say)
    folder.mkdir(parents=True, exist_ok=True)
    clear(folder)  # not before: a run that is cut short leaves the earlier report
    say("add: write the model with the effects")
    outcome = added(problem, naming.final, naming.null, naming.plain, folder)
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
