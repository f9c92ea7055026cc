"""A resumable sweep over amount × seed × kind, checked before it starts."""

import contextlib
import json
import time
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from nas_data import registry
from nas_data.atomic_file import write_atomic
from nas_data.count_of import count_of
from nas_data.dataset.content import hash_episodes
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import ACTION, STATE
from nas_data.dataset.versions import check_paired
from nas_data.errors import DatasetInvalid, JointMismatch, ModelFileError, OptionError, OutputExists
from nas_data.models.presets import TrainingOptions
from nas_data.pairing import check_fits, check_source
from nas_data.runs.job_locks import list_locks
from nas_data.runs.parallel import Workers, run_jobs
from nas_data.runs.progress import format_duration
from nas_data.simulators.engines import ENGINES
from nas_data.sources import SourceModel
from nas_data.studies.ablation.evaluation import TrialResult
from nas_data.studies.ablation.kinds.base import FOLDER, ModelKind, find_kind
from nas_data.studies.ablation.kinds.named import read_named
from nas_data.studies.ablation.sweep_data import Amount, Content, SweepData, check_enough
from nas_data.studies.ablation.trial import TRIALS, UNFINISHED, Config, Trial, do_trial, hash_trial_code
from nas_data.typed_json import from_json
from nas_data.visible_files import list_visible_files

SWEEP = "sweep.json"


@dataclass(frozen=True)
class SweepPlan:
    """Settings of a sweep."""

    kinds: Sequence[str]  # names of the kinds
    amounts: Sequence[Amount]  # amounts of data, all in one unit
    seeds: Sequence[int]  # seeds of every kind and amount
    options: TrainingOptions  # options of the trainings; each trial has its own seed
    held_out: float | None  # share of held-out episodes; None if another dataset is held out
    material: SweepData  # the data

    def trials(self, content: Content, folder: Path) -> list[Trial]:
        """Return all trials, seed by seed, so that first results cover all amounts; long trials come first in each.

        A long trial at the end would leave the other workers idle.
        """
        source = self.material.source()
        codes = {kind: hash_trial_code(kind, source) for kind in self.kinds}
        return [
            Trial(Config(kind, amount, seed, self.options, self.held_out), content, self.material, folder, codes[kind])
            for seed in self.seeds
            for amount in reversed(self.amounts)
            for kind in self.kinds
        ]

    def identity(self, content: Content) -> dict[str, object]:
        """Return the settings that all trials of a folder share; kinds, amounts and seeds may be added later."""
        return {
            **content.to_json(named=False),
            "unit": self.amounts[0].unit,
            "held-out share": self.held_out,
            **{f"option {name}": value for name, value in asdict(self.options).items() if name != "seed"},
        }


def run_sweep(trials: Sequence[Trial], workers: Workers, retry: bool, say: Callable[[str], None]) -> list[TrialResult]:
    """Run the unfinished trials, and return all results in order.

    Results of other code stay in the folder and are not used.

    Args:
        trials: See `SweepPlan.trials`.
        workers: Where the trials run.
        retry: Whether to repeat failed trials.
        say: Called with a sentence for each result.

    Raises:
        OutputExists: another process works in the folder, and the workers are not shared.
    """
    known = [read_result(trial) for trial in trials]
    results = {n: result for n, result in enumerate(known) if result is not None and not (retry and result.failed)}
    waiting = [number for number in range(len(trials)) if number not in results]
    jobs = [(trials[number], known[number]) for number in waiting]
    progress = SweepProgress([trial.config for trial, _ in jobs], workers, len(trials))
    if others := count_other_code(trials):
        say(f"{others} of these trials have results of another version of nas_data, which are kept but not used")
    say(progress.begin(sum(result.failed is not None for result in results.values())))
    locks = list_locks(trials[0].folder, [trial.key for trial, _ in jobs]) if jobs else ()
    for index, result in run_jobs(do_unfinished, jobs, workers, locks=locks):
        results[waiting[index]] = result
        say(progress.describe(jobs[index][0].config, result))
    if not workers.shared:
        with contextlib.suppress(OSError):  # a killed trial of another sweep left something there, or nothing was run
            (trials[0].folder / UNFINISHED).rmdir()
    return [results[number] for number in range(len(trials))]


def do_unfinished(job: tuple[Trial, TrialResult | None]) -> TrialResult:
    """Run a trial, unless another process has done it meanwhile; the job has its failed result that is repeated."""
    trial, repeated = job
    result = read_result(trial)
    return do_trial(trial) if result is None or result == repeated else result


def read_result(trial: Trial) -> TrialResult | None:
    """Return a trial's stored result; None if there is no valid one."""
    try:
        record = json.loads(trial.path.read_text(encoding="utf-8"))
        result = from_json(TrialResult, record)
    except (OSError, ValueError):
        return None
    return result if record.get("question") == trial.question else None


def count_other_code(trials: Sequence[Trial]) -> int:
    """Return the number of trials with a result by other code, or by unknown code."""
    asked = {format_question(trial.question): trial.code for trial in trials}
    found = [read_question(path) for path in list_visible_files(trials[0].folder / TRIALS, "*.json")]
    return len(
        {
            key
            for question in found
            if (key := format_question(question)) in asked and question.get("code") != asked[key]
        }
    )


def read_question(path: Path) -> Mapping[str, object]:
    """Return the identity of a stored result; empty if it is damaged."""
    try:
        question = json.loads(path.read_text(encoding="utf-8"))["question"]
    except (OSError, ValueError, LookupError, TypeError):
        return {}
    return question if isinstance(question, dict) else {}


def format_question(question: Mapping[str, object]) -> str:
    """Return a trial's identity as text, without its code hash."""
    return json.dumps({key: value for key, value in question.items() if key != "code"}, sort_keys=True)


class SweepProgress:
    """Progress of a sweep: each result as it arrives, and the remaining time."""

    def __init__(self, waiting: Sequence[Config], workers: Workers, total: int) -> None:
        """Start with the waiting trials; `total` includes finished ones."""
        self.waiting = list(waiting)
        self.workers = max(1, min(workers.count, len(waiting)))
        self.shared = workers.shared
        self.began = time.monotonic()
        self.total = total
        self.took: dict[str, list[float]] = defaultdict(list)

    def begin(self, failed: int) -> str:
        """Return the number of trials to run as text."""
        before = self.total - len(self.waiting)
        known = (
            f"{before} of {count_of(self.total, 'trial')} were done before"
            if before
            else f"{count_of(self.total, 'trial')}"
        )
        again = f" ({failed} of them failed; --retry does them again)" if failed else ""
        return f"{known}{again}; {len(self.waiting)} to do with {count_of(self.workers, 'worker')}"

    def describe(self, config: Config, result: TrialResult) -> str:
        """Return a trial's result, the number of finished trials, and the remaining time as text."""
        self.waiting.remove(config)
        seconds = result.wall_seconds
        self.took[config.kind].append(seconds)
        found = f"failed: {result.failed}" if result.failed else format_error(config.kind, result)
        left = f", about {format_duration(self.left())} left" if self.waiting else ""
        head = f"{self.total - len(self.waiting)} of {self.total}: {config.kind}, {config.amount}, seed {config.seed}"
        return f"{head}: {found} ({seconds:.0f} s{left})"

    def left(self) -> float:
        """Return the remaining time [s], estimated from finished trials of each kind."""
        if self.shared:  # by an unknown number of workers
            done = sum(map(len, self.took.values()))
            return (time.monotonic() - self.began) / done * len(self.waiting)
        every = [seconds for took in self.took.values() for seconds in took]
        return sum(float(np.mean(self.took.get(c.kind) or every)) for c in self.waiting) / self.workers


def format_error(kind: str, result: TrialResult) -> str:
    """Return the errors of a trial's own predictor as text."""
    loop, step = (result.error(way, kind) for way in ("open_loop", "one_step"))
    text = result.shown.text
    return f"open loop {text(loop, 3) if np.isfinite(loop) else 'diverged'}, one step {text(step, 4)}"


def begin_sweep(folder: Path, identity: Mapping[str, object]) -> None:
    """Claim a sweep's folder: a new one, or that of the same sweep.

    Raises:
        OutputExists: it holds something else.
    """
    check_same(folder, identity)
    write_atomic(folder / SWEEP, (json.dumps(identity, indent=1) + "\n").encode())


def check_same(folder: Path, identity: Mapping[str, object]) -> None:
    """Raise OutputExists if a folder holds another sweep or something else."""
    if not folder.is_file() and not list_visible_files(folder):
        return
    try:
        held = json.loads((folder / SWEEP).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        raise OutputExists(f"{folder} exists and is not a sweep; choose another --out.") from None
    other = [key for key in {**identity, **held} if held.get(key) != identity.get(key)]
    if other:
        shown = "; ".join(f"{key}: {shorten(held.get(key))} there, {shorten(identity.get(key))} here" for key in other)
        raise OutputExists(f"{folder} holds another sweep ({shown}); choose another --out.")


def shorten(value: object) -> str:
    """Return a value for an error message; hashes are shortened."""
    return value[:8] if isinstance(value, str) else "none" if value is None else str(value)


def check(plan: SweepPlan) -> None:
    """Refuse a plan that cannot be run.

    Raises:
        NasError: says what is wrong, and the remedy.
    """
    check_seeds(plan)
    if not plan.kinds:
        raise OptionError(
            f"--kinds is empty; give some of {', '.join(registry.list_names(FOLDER))}, separated by commas."
        )
    kinds = {name: find_kind(name) for name in plan.kinds}
    dataset = plan.material.read()
    check_held_out(plan, dataset)
    check_sources(plan, dataset, kinds)
    for seed in plan.seeds:
        train, held = plan.material.divide(dataset, plan.held_out, seed)
        for amount in plan.amounts:
            check_enough(dataset, train, amount)
        if plan.material.test is not None:
            check_test(plan, dataset, held)


def check_seeds(plan: SweepPlan) -> None:
    """Refuse negative and repeated seeds."""
    if not plan.seeds or min(plan.seeds) < 0 or len(set(plan.seeds)) < len(plan.seeds):
        raise OptionError(f"--seeds are {', '.join(map(str, plan.seeds))}; give different numbers, 0 or more.")


def check_held_out(plan: SweepPlan, dataset: Dataset) -> None:
    """Refuse a share out of range, and a single episode, which cannot be both training and held-out data."""
    if plan.held_out is None:
        return
    if not 0 < plan.held_out < 1:
        raise OptionError(f"--held-out is {plan.held_out:g}; it must lie between 0 and 1, for example 0.2.")
    if dataset.n_episodes < 2:
        raise DatasetInvalid(
            f"{plan.material.root} has one episode, which cannot serve for both training and testing; record more, or "
            "give a test dataset: --test DATASET."
        )


def check_sources(plan: SweepPlan, dataset: Dataset, kinds: dict[str, ModelKind]) -> None:
    """Refuse kinds without the source or the pairs that they need."""
    material, source = plan.material, plan.material.source()
    for name, kind in kinds.items():
        if kind.needs_pairs:
            check_paired(material.root, dataset, f"The kind {name}", ", or leave it out (--kinds forward)")
        if kind.needs_source and source is None:
            raise ModelFileError(
                f"The kind {name} needs a source, and {material.root} stores none; give --model MODEL.xml."
            )
        if kind.names and source is not None:
            check_naming(plan, dataset, source, name)
    if source is not None:
        simulator = source.simulator(dataset, threads=1)
        pairs = any(kind.needs_pairs for kind in kinds.values())
        (check_source if pairs else check_fits)(dataset, simulator)


def check_naming(plan: SweepPlan, dataset: Dataset, source: SourceModel, kind: str) -> None:
    """Refuse a source that naming does not support, and given effects of another robot."""
    if plan.material.effects is not None:
        read_named(plan.material.effects, source, dataset, plan.material.root)
    elif source.engine != ENGINES[0] or source.effects:
        what = f"runs in {source.engine}" if source.engine != ENGINES[0] else "has effects already"
        raise ModelFileError(
            f"The source of {plan.material.root} {what}, and the kind {kind} names effects in a plain model in MuJoCo; "
            "give one with --model, or effects of a gap report with --effects."
        )


def check_test(plan: SweepPlan, dataset: Dataset, test: Dataset) -> None:
    """Refuse a test dataset of another robot, or one that shares episodes with the training data."""
    name = plan.material.test
    mine, other = ((d.joints, d.kinds, round(d.fps, 1)) for d in (dataset, test))
    if mine != other:
        raise JointMismatch(
            f"{name} cannot be the test dataset: its joints, kind of command or rate ({', '.join(other[0])}; "
            f"{other[2]:g} Hz) are "
            f"not those of {plan.material.root} ({', '.join(mine[0])}; {mine[2]:g} Hz)."
        )
    trained = {digest: place for place, digest in enumerate(hash_episodes(dataset, (STATE, ACTION)))}
    for place, digest in enumerate(hash_episodes(test, (STATE, ACTION))):
        if digest in trained:
            raise DatasetInvalid(
                f"Episode {place} of {name} is episode {trained[digest]} of {plan.material.root}: test episodes must "
                "not be training episodes; divide the dataset with `nas split`."
            )
