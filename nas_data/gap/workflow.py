"""Workflow from a dataset and a model to a gap report: find, name, add, show."""

import hashlib
import shlex
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from nas_data.dataset.content import hash_content
from nas_data.dataset.provenance import read_package_versions, read_provenance
from nas_data.errors import NasError, OptionError
from nas_data.gap.compose import Proposal, compose, write_series
from nas_data.gap.episode_batch import EpisodeBatch
from nas_data.gap.experiments.experiment import Rival, choose_next_experiment, write_experiment
from nas_data.gap.finding.find import find
from nas_data.gap.floor import compute_floor_ratios
from nas_data.gap.name import ADEQUATE, Naming, name
from nas_data.gap.output_folder import check_output_folder, clear_report
from nas_data.gap.problem import Problem
from nas_data.gap.report import GapReport
from nas_data.gap.report_parts import GapFindings, MadeFrom, TriedExperiment
from nas_data.gap.score_model import HeldOutResult, predict_held, score_model
from nas_data.gap.search.final import FinalFit, fit_final
from nas_data.gap.search.hypothesis import Description
from nas_data.gap.showing.show import show
from nas_data.gap.write_model import write_difference, write_effects
from nas_data.joint_units import average_by_kind
from nas_data.mjcf.export import check_portable
from nas_data.robots.base import TORQUES
from nas_data.runs.progress import Report, silence
from nas_data.typed_json import from_json

EXPERIMENT = "next_experiment.csv"


def investigate(
    dataset: str | Path, model: str | Path, out: str | Path, say: Report = silence, learn: int = 0
) -> GapReport:
    """Run the workflow on a dataset's folder; see `investigate_problem`."""
    return investigate_problem(lambda: Problem.load(dataset, model), model, out, say, learn)


def investigate_problem(
    load: Callable[[], Problem], model: str | Path, out: str | Path, say: Report = silence, learn: int = 0
) -> GapReport:
    """Run the workflow.

    Args:
        load: Reads dataset and model; called after the output folder is checked.
        model: Robot's name or model file.
        out: Folder of the report; an earlier report in it is replaced.
        say: Receives progress messages.
        learn: Number of updates of φ on the remaining gap; 0 for none.

    Returns:
        The report with the files of its folder.

    Raises:
        NasError: the dataset or the model cannot be used.
        OutputExists: the folder holds files that no report wrote and this one would replace.
        OptionError: the number of updates is negative.
    """
    began, folder = time.monotonic(), Path(out)
    if learn < 0:
        raise OptionError(f"--learn is {learn}; give 0, which leaves φ out, or a number of updates such as 400.")
    check_output_folder(folder, model)
    problem = load()
    check_portable(problem.train.nominal.spec, problem.train.nominal.robot.mjcf)
    say("find: where model and recording disagree")
    found = find(problem.dataset, problem.evidence, problem.as_given, problem.train.floor, problem.overlaps)
    return name_and_report(problem, found, folder, began, say, learn)


def name_and_report(
    problem: Problem, found: GapFindings, folder: Path, began: float, say: Report, learn: int
) -> GapReport:
    """Name effects, write and score the model, and write the report."""
    if found.undecidable:
        say("; ".join(found.undecidable))
    say("name: which effect is missing")
    naming = name(problem.train, problem.held, say)
    folder.mkdir(parents=True, exist_ok=True)
    clear_report(folder)  # late, so that an interrupted run keeps the earlier report
    say("add: write the model with the effects")
    naming, outcome = deliver(problem, naming, folder, say)
    if learn:
        say("learn: φ on what the names leave")
        outcome = replace(outcome, learned=train_on_top(problem, outcome.model, learn, say))
    experiment = propose_experiment(problem, naming, folder, say)
    report = compose(problem, found, naming, outcome, experiment, time.monotonic() - began)
    report = replace(report, made_from=record_origin(problem, folder, learn))
    write_difference(folder, problem.as_given, problem.names[1])
    report.write(folder)
    write_series(folder, problem, naming, outcome)
    say("show: draw it")
    show(folder)
    return report.with_files(folder)


def record_origin(problem: Problem, folder: Path, learn: int) -> MadeFrom:
    """Return the command that reproduces a report, the hashes of its input, and versions."""
    given = str(problem.model_file)
    words = ["nas", "gap", str(problem.root or "DATASET"), "--model", given.removesuffix(TORQUES), "--out", str(folder)]
    words += ["--actuators", "torque"] if given.endswith(TORQUES) else []
    words += ["--learn", str(learn)] if learn else []
    provenance = None if problem.root is None else read_provenance(problem.root)
    return MadeFrom(
        command=shlex.join(words),
        content_hash=provenance.content_hash if provenance else hash_content(problem.dataset),
        model_sha256=hashlib.sha256(problem.train.nominal.robot.mjcf.read_bytes()).hexdigest(),
        versions=read_package_versions(),
    )


def deliver(problem: Problem, naming: Naming, folder: Path, say: Report) -> tuple[Naming, HeldOutResult]:
    """Write the model with the named effects, or a better one if the plain fit or given model predicts better.

    The file of the named effects is accepted if it reaches the noise floor, or the better of plain fit and given model.
    Else these are tried in order, and the first that is accepted is written:

    1. The names fitted with finer physics steps, if they have effects that a file expresses only with fine steps.
    2. The names that MJCF expresses with the changes of the plain fit, if the names are accepted in simulation.
    3. All names with the changes of the plain fit.
    4. The plain fit or the given model, without names.
    """
    outcome = score_model(problem, naming.final, naming.null, naming.plain, folder)
    held = problem.held.evidence
    scales = average_by_kind(problem.held.floor, held.joints, problem.held.nominal.slides)
    best = min(rms(held, outcome.plain, scales), rms(held, outcome.before, scales))

    def is_accepted(predicted: np.ndarray) -> bool:
        at_floor = compute_floor_ratios(held.mean_squares(predicted), problem.held.floor).max() <= ADEQUATE
        return bool(at_floor) or rms(held, predicted, scales) <= best

    if is_accepted(outcome.written):
        return naming, outcome
    say("the written names predict held-out episodes worse than the plain fit or the model as given")
    description = naming.description.with_effects(naming.final.effects)
    has_hooks = not all(effect.in_model for effect in naming.final.effects)
    if has_hooks and not naming.final.fine:
        fine = fit_final(replace(problem.train, fine=True), description, dict(naming.final.factors), rounds=1)
        other = score_model(problem, fine, naming.null, naming.plain, folder)
        if is_accepted(other.written):
            return naming.with_fit(fine), other
    train = replace(problem.train, fine=naming.final.fine)
    both = description.merge(naming.plain_description)
    factors = {**naming.plain.factors, **select_bound_factors(naming.final.factors, both)}
    if has_hooks and is_accepted(outcome.after):
        part = fit_final(train, select_written_effects(both), factors)
        if is_accepted(predict_held(problem, part)):
            written = score_model(problem, part, naming.null, naming.plain, folder)
            write_effects(folder, naming.final.effects, naming.final.factors, slides=problem.held.nominal.slides)
            return naming, replace(written, after=outcome.after, whole=False, delivered="names of MJCF and plain")
    together = fit_final(train, both, factors)
    if naming.findings and is_accepted(predict_held(problem, together)):
        naming = naming.with_fit(together)
        more = score_model(problem, together, naming.null, naming.plain, folder)
        return naming, replace(more, delivered="names and plain")
    plain_is_best = rms(held, outcome.plain, scales) <= rms(held, outcome.before, scales)
    nameless = replace(
        naming, findings=(), rivals=(), final=naming.plain if plain_is_best else FinalFit((), {}, (), fine=False)
    )
    chosen = problem if plain_is_best else problem.with_contacts()
    delivered = score_model(chosen, nameless.final, naming.null, naming.plain, folder)
    return nameless, replace(delivered, delivered="plain" if plain_is_best else "given")


def select_written_effects(description: Description) -> Description:
    """Return the description without the effects that a model file does not express by itself."""
    effects = tuple(effect for effect in description.effects if effect.in_model)
    names = {effect.name() for effect in effects}
    return replace(description, effects=effects, shared=description.shared & names)


def select_bound_factors(factors: Mapping[str, float], description: Description) -> dict[str, float]:
    """Return the factors of the parameters that a description does not free."""
    return {name: factor for name, factor in factors.items() if name not in description.freed}


def rms(evidence: EpisodeBatch, predicted: np.ndarray, scales: np.ndarray) -> float:
    """Return the error over all episodes and joints, each divided by its scale [rad; m], shape (n,)."""
    return float(np.sqrt((evidence.mean_squares(predicted) / scales**2).mean()))


def train_on_top(problem: Problem, model: Path, updates: int, say: Report) -> Mapping[str, float]:
    """Train φ on the written model; torch is imported here only."""
    from nas_data.gap.learned import measure_learned_shares

    numbers = [sorted({int(number) for number in task.evidence.numbers}) for task in (problem.train, problem.held)]
    return measure_learned_shares(
        problem.dataset, (problem.model_file, model), (numbers[0], numbers[1]), model.parent, updates, say
    )


def propose_experiment(problem: Problem, naming: Naming, folder: Path, say: Report = silence) -> Proposal:
    """Write the commands of the experiment that decides the least certain name, and describe it."""
    rival = naming.least_sure_rival
    if rival is None:
        return Proposal()
    say("comparing experiments that would settle the most doubtful name")
    pair = (
        Rival(naming.final.effects, dict(naming.final.factors)),
        Rival(rival.effects, rival.fit.factors),
    )
    try:
        experiment = choose_next_experiment(problem.train.nominal, pair, problem.train.floor, seed=0)
    except NasError as error:
        return Proposal(f"none could be computed: {error}")
    write_experiment(experiment, folder / EXPERIMENT)
    compared = tuple(from_json(TriedExperiment, row) for row in experiment.to_json())
    return Proposal(f"{experiment.text} (commands in {EXPERIMENT})", compared)
