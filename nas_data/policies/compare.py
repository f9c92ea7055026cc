"""Comparison of methods on one target: each method and seed is one run with one JSON file, done once."""

import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from nas_data.envs.loop.dynamics_spec import DynamicsSpec
from nas_data.errors import OptionError, SimulationDiverged
from nas_data.policies.evaluate import score_policy, summarise_spread
from nas_data.policies.folder import write
from nas_data.policies.learner import Hyperparameters, PolicyTraining
from nas_data.policies.policy import load_policy, read_progress
from nas_data.policies.ppo import Report, check_folder, to_stderr, train
from nas_data.policies.share import Share, Stake, share, share_heading, stake
from nas_data.policies.tables import align_columns
from nas_data.runs.code_hash import code_hash
from nas_data.runs.parallel import run_jobs

RESULT = "result.json"
SOURCE_METHOD, EXPERT_METHOD = "source", "expert"  # the lower and upper reference of the relative score

Record = dict[str, object]


@dataclass(frozen=True)
class Study:
    """A comparison of methods.

    Attributes:
        target: Dynamics on which all policies are evaluated.
        methods: Dynamics on which each method trains.
        seeds: Seeds of every method.
        frames: Control steps of each training.
        episodes: Episodes of each evaluation, the same for all policies.
        hyperparameters: Hyperparameters of PPO.
        dataset: Content hash of the dataset behind learned and named dynamics; None if unknown.
    """

    target: DynamicsSpec
    methods: Mapping[str, DynamicsSpec]
    seeds: Sequence[int] = (0, 1, 2, 3, 4)
    frames: int = 2_000_000
    episodes: int = 100
    hyperparameters: Hyperparameters = field(default_factory=Hyperparameters)
    dataset: str | None = None

    def trained_as(self, method: str) -> str:
        """Return the first method that trains on the same dynamics; both share their policies."""
        return next(name for name, plant in self.methods.items() if plant == self.methods[method])

    @property
    def trained(self) -> tuple[str, ...]:
        """The methods whose policies are trained, one for each distinct dynamics."""
        return tuple(method for method in self.methods if self.trained_as(method) == method)


@dataclass(frozen=True)
class Run:
    """One method with one seed: everything that determines its result, and its folder."""

    method: str
    training: PolicyTraining
    target: DynamicsSpec
    episodes: int
    folder: Path
    quiet: bool = False
    dataset: str | None = None

    def question(self) -> dict[str, object]:
        """Return what determines the result; runs with equal identities are the same."""
        training, rollout = self.training, self.training.hyperparameters.rollout
        return {
            "method": self.method,
            "training": {**training.identity(), "frames": training.rollouts * rollout},
            "target": self.target.describe(),
            "episodes": self.episodes,
            "code": code_hash(*self.target.modules(), "nas_data.policies.evaluate"),
        }


def check_run(run: Run) -> None:
    """Refuse a run whose folder holds another one, before any work is done.

    Raises:
        OutputExists: the folder holds another training, or one by other code.
    """
    if read_record(run, run.question()) is None:
        check_folder(run.folder, run.training)


def read_record(run: Run, question: Record) -> Record | None:
    """Return the record of a finished run; None if it is not finished."""
    known = read_result(run.folder)
    return known if known is not None and known.get("question") == question else None


def do_run(run: Run) -> Record:
    """Train and evaluate one policy, or read the record of an earlier run.

    Raises:
        OutputExists: the folder holds another training.
        CheckpointError: the plant's checkpoint cannot be used.
        SimulationDiverged: the plant cannot be simulated at all.
    """
    question = run.question()
    known = read_record(run, question)
    if known is not None:
        return known
    try:
        train(run.training, run.folder, report=silence if run.quiet else None)
        wall, cpu = time.perf_counter(), time.process_time()
        score = score_policy(load_policy(run.folder), run.target, run.episodes)
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    except SimulationDiverged as error:
        raise SimulationDiverged(f"{run.method}, seed {run.training.seed}: {error}") from error
    curve = read_progress(run.folder)
    record: Record = {
        "question": question,
        "circumstances": {**run.training.circumstances(), "dataset": run.dataset},
        "score": score.describe(),
        "returns": score.returns.tolist(),
        "wall_seconds": float(curve["seconds"][-1]),
        "cpu_seconds": float(curve["cpu_seconds"][-1]),
        "judging": {"wall_seconds": wall, "cpu_seconds": cpu},
        "diverged": {"learning": int(curve["diverged"].sum()), "judging": int(score.diverged.sum())},
    }
    write(run.folder / RESULT, (json.dumps(record, indent=1) + "\n").encode())
    return record


def silence(_: str) -> None:
    """Report nothing: several workers would talk at once."""


def read_result(folder: Path) -> Record | None:
    """Return a finished run's record; None if there is no valid one."""
    try:
        record = json.loads((folder / RESULT).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return record if isinstance(record, dict) else None


def compare(
    study: Study, folder: Path, workers: int = 1, report: Report = to_stderr, quiet: bool = False
) -> "Comparison":
    """Train and evaluate every method with every seed; finished runs are skipped.

    Args:
        study: The comparison.
        folder: Results: `<method>/seed<seed>/` holds policy, learning curve and `result.json`. Methods with equal
            dynamics share the folder of the first one.
        workers: Number of parallel processes.
        report: Called with a sentence after each finished run.
        quiet: Whether trainings print no progress; several workers never do.

    Raises:
        OptionError: there is no method or no seed, or a seed is negative.
        UnknownName: an environment or a dynamics does not exist.
        JobsFailed: several runs failed; the others are finished and will not be repeated.
        OutputExists: the folder holds a run of another study, or one by other code, under the same name.
    """
    if not study.methods or not study.seeds:
        raise OptionError("A comparison needs at least one method and one seed.")
    if min(study.seeds) < 0:
        raise OptionError(f"--seed {min(study.seeds)} is negative; seeds must be 0 or more.")
    for plant in (study.target, *study.methods.values()):
        plant.check()  # before any long run
    runs = [
        Run(
            method=method,
            training=PolicyTraining(study.methods[method], seed, study.frames, study.hyperparameters),
            target=study.target,
            episodes=study.episodes,
            folder=folder / method / f"seed{seed}",
            quiet=quiet or workers > 1,
            dataset=study.dataset,
        )
        for seed in study.seeds
        for method in study.trained
    ]
    for run in runs:
        check_run(run)
    records: dict[tuple[str, int], Record] = {}
    for number, record in run_jobs(do_run, runs, workers):
        run = runs[number]
        records[run.method, run.training.seed] = record
        report(f"{len(records)} of {len(runs)}: {run.method}, seed {run.training.seed}: {tell(record)}")
    for method in study.methods:
        records |= {(method, seed): records[study.trained_as(method), seed] for seed in study.seeds}
    return Comparison(study=study, folder=folder, records=records)


def tell(record: Record) -> str:
    """Return a sentence on a run's result."""
    return f"return {number(record, 'return'):.2f}, success {number(record, 'success_rate'):.0%}"


def number(record: Record, key: str) -> float:
    """Return a number of a run's score."""
    score = record["score"]
    assert isinstance(score, dict)
    return float(score[key])


@dataclass(frozen=True)
class Comparison:
    """Results of a comparison.

    Attributes:
        study: The comparison.
        folder: Folder of policies, learning curves and results.
        records: Record of each method and seed.
    """

    study: Study
    folder: Path
    records: Mapping[tuple[str, int], Record]

    def values(self, method: str, key: str = "return") -> np.ndarray:
        """Return a score of each seed of a method on the target, shape (seeds,)."""
        return np.array([number(self.records[method, seed], key) for seed in self.study.seeds])

    def diverged(self, method: str, when: str) -> np.ndarray:
        """Return the number of diverged episodes of each seed while `learning` or `judging`, shape (seeds,)."""
        counts = [self.records[method, seed]["diverged"] for seed in self.study.seeds]
        return np.array([count[when] for count in counts if isinstance(count, dict)])

    def lost(self) -> list[str]:
        """Return sentences on methods with diverged episodes."""
        said = []
        for method in self.study.methods:
            learning, judging = (int(self.diverged(method, when).sum()) for when in ("learning", "judging"))
            if learning or judging:
                said.append(
                    f"{method}: {learning:,} episodes while learning and {judging} while judged left all bounds; each "
                    "was ended there, with the least reward for every step that it still had."
                )
        return said

    def shared(self) -> list[str]:
        """Return sentences on methods that share the policies of another."""
        return [
            f"{method} learns where {self.study.trained_as(method)} does: they have the same policies."
            for method in self.study.methods
            if method not in self.study.trained
        ]

    def policy_folder(self, method: str, seed: int) -> Path:
        """Return the folder of a policy."""
        return self.folder / self.study.trained_as(method) / f"seed{seed}"

    def share_closed(self, method: str) -> Share | None:
        """Return the relative score of a method between source and expert; None for these two."""
        ends = {SOURCE_METHOD, EXPERT_METHOD}
        if method in ends or not ends <= set(self.study.methods):
            return None
        return share(self.values(method), self.values(SOURCE_METHOD), self.values(EXPERT_METHOD))

    def at_stake(self) -> Stake | None:
        """Return the difference of expert and source returns; None if one of them is not compared."""
        if not {SOURCE_METHOD, EXPERT_METHOD} <= set(self.study.methods):
            return None
        return stake(self.values(SOURCE_METHOD), self.values(EXPERT_METHOD))

    def describe(self) -> dict[str, object]:
        """Return the comparison for JSON."""
        at_stake = self.at_stake()
        return {
            "target": self.study.target.describe(),
            "frames": self.study.frames,
            "episodes": self.study.episodes,
            "seeds": list(self.study.seeds),
            "at_stake": None if at_stake is None else at_stake.describe(),
            "methods": {method: self._describe_method(method) for method in self.study.methods},
        }

    def _describe_method(self, method: str) -> dict[str, object]:
        closed = self.share_closed(method)
        return {
            "returns": self.values(method).tolist(),
            "success_rates": self.values(method, "success_rate").tolist(),
            "return": summarise_spread(self.values(method)),
            "success_rate": summarise_spread(self.values(method, "success_rate")),
            "diverged": {when: self.diverged(method, when).tolist() for when in ("learning", "judging")},
            "share_closed": None if closed is None else closed.describe(),
        }

    def table(self) -> str:
        """Return the comparison as text."""
        closed = share_heading(len(self.study.seeds))
        headers = ("method", "seeds", "return: median", "min … max", "success: median", closed)
        at_stake = self.at_stake()
        nothing = None if at_stake is None else at_stake.sentence()
        told = [*([nothing] if nothing else []), *self.shared(), *self.lost()]
        return "\n".join([align_columns(headers, [self._row(method) for method in self.study.methods]), *told])

    def _row(self, method: str) -> tuple[str, ...]:
        returns, success = summarise_spread(self.values(method)), summarise_spread(self.values(method, "success_rate"))
        closed = self.share_closed(method)
        return (
            method,
            str(len(self.study.seeds)),
            f"{returns['median']:.2f}",
            f"{returns['min']:.2f} … {returns['max']:.2f}",
            f"{success['median']:.0%}",
            "" if closed is None else str(closed),
        )
