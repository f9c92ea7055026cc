"""Policies for a number of trajectories: models are trained or effects named on a nested subset, then policies."""

import json
import time
from collections.abc import Callable, Mapping
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

from nas_data.atomic_file import write_atomic
from nas_data.dataset import versions
from nas_data.dataset.content import hash_content
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.provenance import read_provenance
from nas_data.dataset.read import read
from nas_data.envs.loop.dynamics_spec import DynamicsSpec
from nas_data.gap import workflow
from nas_data.gap.model_correction import ModelCorrection
from nas_data.gap.side_by_side import on_one_core
from nas_data.gap.verdict import EXPLAINED_VERDICTS
from nas_data.gap.write_model import EFFECTS
from nas_data.models.lstm import Kind
from nas_data.models.presets import TrainingOptions
from nas_data.models.split import select_frames
from nas_data.policies.compare import Run, do_run
from nas_data.policies.policy import Hyperparameters, PolicyResult
from nas_data.policies.ppo import PolicyTraining
from nas_data.runs.progress import silence
from nas_data.studies.ablation.sweep_data import Amount, draw
from nas_data.studies.experiments.pipeline.artifacts import (
    DATASETS,
    METHODS,
    NAMED,
    NAMES,
    PHI,
    PHI_NAMED,
    PSI,
    Artifacts,
    add_to_source,
    make_target,
)
from nas_data.studies.experiments.pipeline.learning import ModelJob, read_record, train_model
from nas_data.studies.experiments.pipeline.pairs import pair_again
from nas_data.studies.experiments.pipeline.sizes import FOR_FEW
from nas_data.studies.experiments.pipeline.stages import hash_naming_code

SUBSET = "subset"
BY_PRESET = {f"nas_{name}": name for name in FOR_FEW}


class Names(NamedTuple):
    """Effects named from a subset."""

    folder: Path | None  # the gap report; None if it has neither effects nor changed base parameters
    seconds: float  # duration [s]
    explained: bool  # whether the residual is at the recording's noise floor


Learned = tuple[DynamicsSpec, float]  # training dynamics of a policy, and the time to build it [s]


@dataclass(frozen=True)
class CountJob:
    """A number of trajectories and a seed."""

    material: Artifacts  # recording with the trajectories, and trainings of φ and ψ
    methods: tuple[str, ...]  # methods to run, some of `LEARNED`
    count: int  # number of trajectories; for equal seeds, smaller subsets are parts of larger ones
    seed: int  # seed of the subset, of φ and ψ, and of the policies
    frames: int  # control steps of each policy's training
    episodes: int  # evaluation episodes of each policy
    hyperparameters: Hyperparameters  # hyperparameters of PPO
    policies: str  # folder of policies with this length and PPO
    folder: Path  # folder of models, named effects and policies
    presets: Mapping[str, TrainingOptions]  # trainings of φ by presets for few trajectories, by name
    threads: int | None = None  # threads for simulation and search; None for all cores

    def subset(self, dataset: Dataset) -> Dataset:
        """Return the indices of the training trajectories."""
        runs = draw(dataset, range(dataset.n_episodes), Amount(self.count, "episodes"), self.seed)
        return select_frames(dataset, runs)

    def recorded(self) -> Path:
        """Return a dataset of these trajectories alone."""
        train = self.material.train
        provenance = read_provenance(train)
        assert provenance is not None  # the material recorded it
        return versions.write_version(self.subset(read(train)), SUBSET, provenance, self.folder / DATASETS)

    def seeded(self, options: TrainingOptions) -> TrainingOptions:
        """Return options of a training with this seed."""
        return replace(options, seed=self.seed)


def learn(job: CountJob, kind: Kind, options: TrainingOptions, folder: str) -> Learned:
    """Train φ or ψ on the subset."""
    model = ModelJob(kind, job.material.train, job.seeded(options), job.folder / folder, job.threads)
    history = train_model(model, silence, job.subset)
    return add_to_source(job.material, str(model.folder)), history[-1]["seconds"]


def learn_by(job: CountJob, preset: str) -> Learned:
    """Train φ on the subset by a preset for few trajectories."""
    return learn(job, "delta", job.presets[preset], f"{PHI}_{preset}")


def name_subset(job: CountJob) -> Names:
    """Run `nas gap` on the subset alone; a finished report is read."""
    folder, root = job.folder / NAMES, job.recorded()
    record = folder.with_name(f"{NAMES}.json")
    identity = {"named_from": hash_content(read(root)), "code": hash_naming_code(job.material.plan)}
    held = read_record(record)
    if held.get("identity") != identity or not (folder / EFFECTS).is_file():
        began = time.monotonic()
        with on_one_core() if job.threads == 1 else nullcontext():
            report = workflow.investigate(root, job.material.train / "meta/source.xml", folder, silence)
        held = {"identity": identity, "seconds": time.monotonic() - began, "verdict": report.verdict}
        write_atomic(record, (json.dumps(held, indent=1) + "\n").encode())
    named = ModelCorrection.read(folder)
    found = folder if named.effects or named.retuned else None
    return Names(found, held["seconds"], held["verdict"] in EXPLAINED_VERDICTS)


def with_names(job: CountJob) -> Learned:
    """Return the source with the named effects."""
    names = name_subset(job)
    return add_to_source(job.material, effects=None if names.folder is None else str(names.folder)), names.seconds


def with_names_and_phi(job: CountJob) -> Learned:
    """Pair the subset with the source and its named effects, and train φ on the residual, if any."""
    material = job.material
    folder, seconds, explained = name_subset(job)
    if folder is None:
        return learn(job, "delta", material.plan.delta, PHI)
    if explained:
        return add_to_source(material, effects=str(folder)), seconds
    pairs = pair_again(job.recorded(), material.plan.source_with(folder), NAMED, job.folder, DATASETS)
    options = job.seeded(material.plan.delta)
    model = ModelJob("delta", job.folder / pairs.path, options, job.folder / PHI_NAMED, job.threads)
    history = train_model(model, silence)
    return add_to_source(material, str(model.folder), str(folder)), seconds + history[-1]["seconds"]


LEARNED: Mapping[str, Callable[[CountJob], Learned]] = {
    "nas": lambda job: learn(job, "delta", job.material.plan.delta, PHI),
    "forward": lambda job: learn(job, "forward", job.material.plan.forward, PSI),
    "named": with_names,
    "named_nas": with_names_and_phi,
} | {method: partial(learn_by, preset=name) for method, name in BY_PRESET.items()}
LEARNED_ON = {name: method.learned_on for name, method in METHODS.items()} | {
    method: f"source + φ, preset {name}" for method, name in BY_PRESET.items()
}


def do_count(job: CountJob) -> dict[str, tuple[PolicyResult, float]]:
    """Build the models and the policy of each method, and evaluate it; finished results are read.

    Returns:
        By method, the policy's result, and the time for training φ or ψ and for naming [s].
    """
    results = {}
    for method in job.methods:
        plant, seconds = LEARNED[method](job)
        run = Run(
            method=method,
            training=PolicyTraining(plant, job.seed, job.frames, job.hyperparameters),
            target=make_target(job.material),
            episodes=job.episodes,
            folder=job.folder / method / job.policies,
            quiet=True,
            dataset=job.material.content_hash,
        )
        results[method] = do_run(run), seconds
    return results
