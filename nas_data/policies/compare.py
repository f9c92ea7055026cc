"""Comparison of methods on one target: each method and seed is one run with one JSON file, done once."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from nas_data.count_of import count_of
from nas_data.envs.loop.dynamics_spec import DynamicsSpec
from nas_data.errors import CheckpointError, OptionError, SimulationDiverged
from nas_data.policies.evaluate import score_policy, summarise_spread
from nas_data.policies.intervals import ReturnRange, Share, compute_return_range, compute_share, format_share_heading
from nas_data.policies.policy import (
    DivergedEpisodes,
    EvaluationTime,
    Hyperparameters,
    PolicyResult,
    load_policy,
    read_progress,
    read_result,
)
from nas_data.policies.ppo import PolicyTraining, check_folder, train
from nas_data.runs.code_hash import hash_code
from nas_data.runs.job_locks import list_locks
from nas_data.runs.parallel import ONE_WORKER, Workers, run_jobs
from nas_data.runs.progress import Report, format_duration, repeating, say, silence
from nas_data.text_table import format_table

SOURCE_METHOD, EXPERT_METHOD = "source", "expert"  # the lower and upper reference of the relative score


@dataclass(frozen=True)
class Study:
    """A comparison of methods."""

    target: DynamicsSpec  # dynamics on which all policies are evaluated
    methods: Mapping[str, DynamicsSpec]  # dynamics on which each method trains
    seeds: Sequence[int] = (0, 1, 2, 3, 4)  # seeds of every method
    frames: int = 2_000_000  # control steps of each training
    episodes: int = 100  # episodes of each evaluation, the same for all policies
    hyperparameters: Hyperparameters = field(default_factory=Hyperparameters)  # hyperparameters of PPO
    dataset: str | None = None  # content hash of the dataset behind learned and named dynamics; None if unknown

    def trained_as(self, method: str) -> str:
        """Return the first method that trains on the same dynamics: its policies serve for this method, too."""
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
        """Return everything that determines the result; runs with equal values are the same."""
        training, rollout = self.training, self.training.hyperparameters.rollout
        return {
            "method": self.method,
            "training": {**training.identity(), "frames": training.rollouts * rollout},
            "target": self.target.describe(),
            "episodes": self.episodes,
            "code": hash_code(*self.target.modules(), "nas_data.policies.evaluate"),
        }


def read_finished(run: Run) -> PolicyResult | None:
    """Return the result of a finished run; None if it is not finished."""
    known = read_result(run.folder)
    return known if known is not None and known.question == run.question() else None


def do_run(run: Run) -> PolicyResult:
    """Train and evaluate one policy, or read the result of an earlier run.

    Raises:
        OutputExists: the folder holds another training.
        CheckpointError: the plant's checkpoint cannot be used.
        SimulationDiverged: the plant cannot be simulated at all.
    """
    known = read_finished(run)
    if known is not None:
        return known
    try:
        train(run.training, run.folder, report=silence if run.quiet else None)
        wall, cpu = time.perf_counter(), time.process_time()
        score = score_policy(load_policy(run.folder), run.target, run.episodes)
        took = EvaluationTime(time.perf_counter() - wall, time.process_time() - cpu)
    except SimulationDiverged as error:
        raise SimulationDiverged(f"{run.method}, seed {run.training.seed}: {error}") from error
    curve = read_progress(run.folder)
    result = PolicyResult(
        question=run.question(),
        circumstances={**run.training.circumstances(), "dataset": run.dataset},
        score=score.summary(),
        returns=tuple(score.returns.tolist()),
        wall_seconds=float(curve["seconds"][-1]),
        cpu_seconds=float(curve["cpu_seconds"][-1]),
        judging=took,
        diverged=DivergedEpisodes(int(curve["diverged"].sum()), int(score.diverged.sum())),
    )
    result.write(run.folder)
    return result


def compare(
    study: Study,
    folder: Path,
    workers: Workers = ONE_WORKER,
    report: Report = say,
    quiet: bool = False,
) -> "Comparison":
    """Train and evaluate every method with every seed; finished runs are skipped.

    Args:
        study: The comparison.
        folder: Results: `<method>/seed<seed>/` holds policy, learning curve and `result.json`. Methods with equal
            dynamics share the folder of the first one.
        workers: Where the runs are done.
        report: Called with a sentence after each finished run.
        quiet: Whether trainings print no progress; several workers never do.

    Raises:
        OptionError: there is no method or no seed, or a seed is negative.
        UnknownName: an environment or a dynamics does not exist.
        JobsFailed: several runs failed; the others are finished and will not be repeated.
        OutputExists: the folder holds a run of another study, or one by other code, under the same name; or another
            process works in it, and the workers are not shared.
    """
    runs = list_runs(study, folder, quiet or workers.one_core)
    results: dict[tuple[str, int], PolicyResult] = {}
    locks = list_locks(folder, [f"{run.method}/seed{run.training.seed}" for run in runs])
    for number, result in run_jobs(do_run, runs, workers, locks=locks):
        run, score = runs[number], result.score
        results[run.method, run.training.seed] = result
        scores = f"return {score.mean_return:.2f}, success {score.success_rate:.0%}"
        report(f"{len(results)} of {len(runs)}: {run.method}, seed {run.training.seed}: {scores}")
    for method in study.methods:
        results |= {(method, seed): results[study.trained_as(method), seed] for seed in study.seeds}
    return Comparison(study=study, folder=folder, results=results)


def list_runs(study: Study, folder: Path, quiet: bool = True) -> list[Run]:
    """Check a comparison before any long run, and return its runs; arguments and errors are those of `compare`."""
    if not study.methods or not study.seeds:
        raise OptionError("A comparison needs at least one method and one seed.")
    if min(study.seeds) < 0:
        raise OptionError(f"--seed {min(study.seeds)} is negative; seeds must be 0 or more.")
    for plant in (study.target, *study.methods.values()):
        plant.check()
    runs = [
        Run(
            method=method,
            training=PolicyTraining(study.methods[method], seed, study.frames, study.hyperparameters),
            target=study.target,
            episodes=study.episodes,
            folder=folder / method / f"seed{seed}",
            quiet=quiet,
            dataset=study.dataset,
        )
        for seed in study.seeds
        for method in study.trained
    ]
    for run in runs:
        if read_finished(run) is None:
            check_folder(run.folder, run.training)
    return runs


@dataclass(frozen=True)
class Comparison:
    """Results of a comparison."""

    study: Study  # the comparison
    folder: Path  # folder of policies, learning curves and results
    results: Mapping[tuple[str, int], PolicyResult]  # result of each method and seed

    def values(self, method: str, name: str = "mean_return") -> np.ndarray:
        """Return one entry of `PolicyScore` for each seed of a method, shape (seeds,)."""
        return np.array([getattr(self.results[method, seed].score, name) for seed in self.study.seeds], float)

    def diverged(self, method: str, when: str) -> np.ndarray:
        """Return each seed's diverged episodes in training (`learning`) or evaluation (`judging`), shape (seeds,)."""
        return np.array([getattr(self.results[method, seed].diverged, when) for seed in self.study.seeds])

    def describe_diverged(self) -> list[str]:
        """Return sentences on methods with diverged episodes."""
        notes = []
        for method in self.study.methods:
            learning, judging = (int(self.diverged(method, when).sum()) for when in ("learning", "judging"))
            if learning or judging:
                notes.append(
                    f"{method}: {count_of(learning, 'episode', ',')} in training and {judging} in evaluation diverged; "
                    "each was ended there, with the lowest reward for each remaining step."
                )
        return notes

    def shared(self) -> list[str]:
        """Return sentences on methods that share the policies of another."""
        return [
            f"{method} trains in the same environment as {self.study.trained_as(method)}: they share their policies."
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
        return compute_share(self.values(method), self.values(SOURCE_METHOD), self.values(EXPERT_METHOD))

    def compute_advantage(self) -> ReturnRange | None:
        """Return the difference of expert and source returns; None if one of them is not compared."""
        if not {SOURCE_METHOD, EXPERT_METHOD} <= set(self.study.methods):
            return None
        return compute_return_range(self.values(SOURCE_METHOD), self.values(EXPERT_METHOD))

    def describe(self) -> dict[str, object]:
        """Return the comparison for JSON."""
        advantage = self.compute_advantage()
        return {
            "target": self.study.target.describe(),
            "frames": self.study.frames,
            "episodes": self.study.episodes,
            "seeds": list(self.study.seeds),
            "at_stake": None if advantage is None else advantage.describe(),
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
        closed = format_share_heading(len(self.study.seeds))
        headers = ("method", "seeds", "return: median", "min … max", "success: median", closed)
        advantage = self.compute_advantage()
        nothing = None if advantage is None else advantage.sentence()
        notes = [*([nothing] if nothing else []), *self.shared(), *self.describe_diverged()]
        return "\n".join([format_table(headers, [self._row(method) for method in self.study.methods]), *notes])

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


PAUSE = 10.0  # [s] between two lines of progress


@contextmanager
def report_training_progress(
    study: Study, folder: Path, report: Callable[[str], None], pause: float = PAUSE
) -> Iterator[None]:
    """Report the progress of training every few seconds.

    Args:
        study: The study.
        folder: Folder of its runs.
        report: Called with each line.
        pause: Time between two lines [s].
    """
    folders = [folder / method / f"seed{seed}" for method in study.trained for seed in study.seeds]
    total, first = study.frames * len(folders), count_frames(folders)
    began, before = time.monotonic(), first

    def report_progress() -> None:
        nonlocal before
        done = min(float(total), count_frames(folders))
        if done > before:
            left = (total - done) / (done - first) * (time.monotonic() - began)
            report(
                f"{count_of(len(folders), 'policy', plural='policies')}: {done / total:.0%} of {total:,} control "
                f"steps, {format_duration(left)} left"
            )
        before = done

    with repeating(report_progress, pause):
        yield


def count_frames(folders: list[Path]) -> float:
    """Return the number of trained control steps of all policies, as written so far."""
    return sum(count_trained_frames(folder) for folder in folders)


def count_trained_frames(folder: Path) -> float:
    """Return the number of trained control steps of a policy; 0 if it has not begun."""
    try:
        return float(read_progress(folder)["frames"][-1])
    except CheckpointError:
        return 0.0
