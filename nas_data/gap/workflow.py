"""Workflow from a dataset and a model to a gap report: find, name, add, show."""

import hashlib
import shlex
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

from nas_data.arrays import thin_evenly
from nas_data.dataset.content import hash_content
from nas_data.dataset.position_gains import P_GAIN_COLUMN
from nas_data.dataset.provenance import read_package_versions, read_provenance
from nas_data.errors import NasError, OptionError
from nas_data.gap.compose import Proposal, compose, write_series
from nas_data.gap.deliver import deliver
from nas_data.gap.experiments.experiment import Explanation, choose_next_experiment, write_experiment
from nas_data.gap.finding.find import find
from nas_data.gap.name import Naming, name
from nas_data.gap.nominal_parameters import FIRM
from nas_data.gap.output_folder import check_output_folder, stage_report
from nas_data.gap.problem import Problem
from nas_data.gap.report import GapReport
from nas_data.gap.report_parts import GapFindings, LearnedCorrection, MadeFrom
from nas_data.gap.showing.page import show
from nas_data.gap.write_model import write_difference
from nas_data.mjcf.export import check_portable
from nas_data.robots.base import TORQUES
from nas_data.runs.progress import Report, silence

EXPERIMENT = "next_experiment.csv"
MOST_RECORDED = 20  # recorded episodes that rivals must explain in a proposed experiment


def investigate(
    dataset: str | Path,
    model: str | Path,
    out: str | Path,
    say: Report = silence,
    learn: int = 0,
    *,
    propose: bool = True,
    baseline: str | Path | None = None,
) -> GapReport:
    """Run the workflow on a dataset's folder; see `investigate_problem`.

    With a baseline, which is a recording that `model` describes, only what differs from it is named.
    """
    load = partial(Problem.load, dataset, model, baseline)
    return investigate_problem(load, model, out, say, learn, propose=propose)


def investigate_problem(
    load: Callable[[], Problem],
    model: str | Path,
    out: str | Path,
    say: Report = silence,
    learn: int = 0,
    *,
    propose: bool = True,
) -> GapReport:
    """Run the workflow.

    Args:
        load: Reads dataset and model; called after the output folder is checked.
        model: Robot's name or model file.
        out: Folder of the report; an earlier report in it is replaced.
        say: Receives progress messages.
        learn: Number of updates of φ on the remaining gap; 0 for none.
        propose: Whether to look for the experiment to record next.

    Returns:
        The report with the files of its folder.

    Raises:
        NasError: the dataset or the model cannot be used.
        OutputExists: the folder holds files that no report wrote and this one would replace.
        OptionError: the number of updates is negative, or φ cannot be learned from this recording.
    """
    began, folder = time.monotonic(), Path(out)
    if learn < 0:
        raise OptionError(f"--learn is {learn}; give 0, which leaves φ out, or a number of updates such as 400.")
    check_output_folder(folder, model)
    problem = load()
    if learn:
        check_learnable(problem)
    check_portable(problem.train.nominal.spec, problem.train.nominal.robot.mjcf)
    for sentence in problem.as_given.known:
        say(sentence)
    say("find: where model and recording disagree")
    found = find_gap(problem)
    return name_and_report(problem, found, folder, began, say, learn, propose=propose)


def check_learnable(problem: Problem) -> None:
    """Refuse to learn φ from episodes at different position gains, which it cannot tell apart.

    Raises:
        OptionError: the recording has such gains.
    """
    if (problem.evidence.gains != 1).any():
        raise OptionError(
            f"--learn: the episodes of {problem.names[0]} have different position gains ({P_GAIN_COLUMN}), which φ "
            "cannot tell apart: leave out --learn."
        )


def find_gap(problem: Problem) -> GapFindings:
    """Compare the recording of a problem with its model."""
    return find(
        problem.dataset, problem.evidence, problem.as_given, problem.train.floor, problem.overlaps, problem.root
    )


def name_and_report(
    problem: Problem,
    found: GapFindings,
    folder: Path,
    began: float,
    say: Report,
    learn: int,
    *,
    propose: bool = True,
) -> GapReport:
    """Name effects, write and score the model, and write the report."""
    if found.undecidable:
        say("; ".join(found.undecidable))
    say("name: which effect is missing")
    named = name(problem.train, problem.held, say, problem.contrast)
    say("add: write the model with the effects")
    with stage_report(folder) as staged:
        naming, outcome = deliver(problem, named, staged, say)
        if learn:
            say("learn: φ on the remaining gap")
            outcome = replace(outcome, learned=train_on_top(problem, outcome.model, learn, say))
        is_open = bool(naming.findings or named.candidates)
        experiment = propose_experiment(problem, named, staged, say) if propose and is_open else Proposal()
        report = compose(problem, found, naming, outcome, experiment, time.monotonic() - began)
        report = replace(report, made_from=record_origin(problem, folder, learn))
        write_difference(staged, problem.without_registers, problem.names[1])
        report.write(staged)
        write_series(staged, problem, naming, outcome)
    say("show: write the report")
    show(folder)
    return report.with_files(folder)


def record_origin(problem: Problem, folder: Path, learn: int) -> MadeFrom:
    """Return the command that reproduces a report, the hashes of its input, and versions."""
    given = str(problem.model_file)
    words = ["nas", "gap", str(problem.root or "DATASET"), "--model", given.removesuffix(TORQUES), "--out", str(folder)]
    words += ["--actuators", "torque"] if given.endswith(TORQUES) else []
    words += ["--learn", str(learn)] if learn else []
    words += ["--baseline", str(problem.baseline.root or "BASELINE")] if problem.baseline else []
    provenance = None if problem.root is None else read_provenance(problem.root)
    return MadeFrom(
        command=shlex.join(words),
        content_hash=provenance.content_hash if provenance else hash_content(problem.dataset),
        model_sha256=hashlib.sha256(problem.train.nominal.robot.mjcf.read_bytes()).hexdigest(),
        versions=read_package_versions(),
    )


def train_on_top(problem: Problem, model: Path, updates: int, say: Report) -> LearnedCorrection:
    """Train φ on the written model; torch is imported here only."""
    from nas_data.gap.phi_shares import learn_correction

    numbers = [sorted({int(number) for number in task.evidence.numbers}) for task in (problem.train, problem.held)]
    return learn_correction(
        problem.dataset, (problem.as_given.robot, model), (numbers[0], numbers[1]), model.parent, updates, say
    )


def propose_experiment(problem: Problem, naming: Naming, folder: Path, say: Report = silence) -> Proposal:
    """Write the commands of the experiment that decides the least certain names, and describe it.

    If nothing is named, it decides whether the best candidate is at work.

    Args:
        problem: Recording and model.
        naming: Names as found, without what is delivered beside them, which their rivals lack.
        folder: Folder of the report.
        say: Receives progress messages.
    """
    leader, others = list_survivors(naming)
    if not others:
        return Proposal()
    say("simulating experiments that would test the least certain names")
    train = problem.train
    recorded = train.evidence.select(thin_evenly(len(train.evidence), MOST_RECORDED))
    try:
        experiment = choose_next_experiment(train.nominal, recorded, leader, others, train.floor, seed=0)
    except NasError as error:
        return Proposal(f"none could be computed: {error}")
    write_experiment(experiment, folder / EXPERIMENT)
    compared = tuple(row.describe() for row in experiment.table)
    what = "commands" if experiment.decides else "commands of varied motion"
    return Proposal(f"{experiment.text} ({what} in {EXPERIMENT}, at {1 / experiment.period:.6g} Hz)", compared)


def list_survivors(naming: Naming) -> tuple[Explanation, list[Explanation]]:
    """Return the best explanation of the recording, and the others that it does not rule out."""
    final = naming.final
    firm = {name: factor for name, factor in final.factors.items() if name.endswith(FIRM)}
    hypotheses = naming.surviving_rivals if naming.findings else naming.candidates
    others = [Explanation(h.effects, {**h.fit.factors, **firm}) for h in hypotheses]
    found = Explanation(final.effects, dict(final.factors))
    return (others[0], [found, *others[1:]]) if others and not naming.findings else (found, others)
