"""Training of φ and ψ on recorded pairs, and their comparison with the baselines on the same episodes."""

import json
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, TypeVar

from nas_data.atomic_file import write_atomic
from nas_data.dataset import versions
from nas_data.dataset.content import hash_content
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.read import read
from nas_data.models import checkpoint
from nas_data.models.evaluation import Evaluation, evaluate
from nas_data.models.lstm import Kind
from nas_data.models.predictions import MODEL
from nas_data.models.presets import TrainingOptions
from nas_data.models.run import CHECKPOINT, HISTORY, STATE, TrainingRun
from nas_data.models.training import ModelTraining
from nas_data.runs.code_hash import hash_code
from nas_data.simulators.base import Simulator
from nas_data.sources import locate_source, read_kept_files

TRAINED_BY = "nas_data.models.run"


@dataclass(frozen=True)
class ModelJob:
    """One model to be trained."""

    kind: Kind  # `delta` for φ, `forward` for ψ
    dataset: Path  # folder of the pairs, with their source
    options: TrainingOptions  # options of the training
    folder: Path  # output folder; a file of the same name beside it records the identity of the training
    threads: int | None = None  # simulation threads of the source; None for all cores

    @property
    def record(self) -> Path:
        """The file with the identity of the training in the folder."""
        return self.folder.with_name(f"{self.folder.name}.json")


def train_model(
    job: ModelJob, report: Callable[[str], None], choose: Callable[[Dataset], Dataset] = lambda whole: whole
) -> list[dict[str, float]]:
    """Train a model, or resume its training.

    Returns:
        Its history, one row per validation.
    """
    dataset = read(job.dataset)
    chosen = choose(dataset)
    parent = versions.make_parent(job.dataset, dataset)
    kept = locate_source(None, (), [job.dataset])
    source = kept.simulator(dataset, job.threads)
    provenance = {
        "dataset": {"name": parent.name, "content_hash": parent.content_hash},
        "source": source.describe(),
    }
    identity = {
        "kind": job.kind,
        "options": asdict(job.options),
        "learned_from": hash_content(chosen),
        "source": provenance["source"],
        "code": hash_code(TRAINED_BY, *kept.modules()),
    }
    claim(job, json.loads(json.dumps(identity)), report)
    history = job.folder / HISTORY
    if not history.is_file() or (job.folder / STATE).exists():
        training = ModelTraining(job.kind, chosen, job.options, source, provenance)
        TrainingRun(training, job.folder, report, read_kept_files(job.dataset)).run()
    rows: list[dict[str, float]] = json.loads(history.read_text(encoding="utf-8"))
    return rows


def claim(job: ModelJob, identity: Mapping[str, object], report: Callable[[str], None]) -> None:
    """Claim the folder for this training; an outdated model in it is removed."""
    held = read_record(job.record)
    if held == identity:
        return
    if any((job.folder / name).exists() for name in (HISTORY, STATE, CHECKPOINT)):
        different = ", ".join(key for key in identity if held.get(key) != identity[key])
        report(f"{job.folder} holds a model that differs in {different}: it is trained again")
        shutil.rmtree(job.folder)
    write_atomic(job.record, (json.dumps(identity, indent=1) + "\n").encode())


def read_record(path: Path) -> dict[str, Any]:
    """Return the recorded identity of a model or gap report; empty if there is no valid one."""
    try:
        held = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return held if isinstance(held, dict) else {}


PREDICTORS = (MODEL["delta"], MODEL["forward"], "source", "hold", "command")  # learned models first
Kept = TypeVar("Kept")


def compare_models(dataset: Dataset, source: Simulator, delta: Path, forward: Path) -> Evaluation:
    """Return the errors of φ, ψ and the trivial baselines on a dataset."""
    phi, psi = (checkpoint.load_for_inference(checkpoint.find_checkpoint(folder)) for folder in (delta, forward))
    return combine(evaluate(dataset, source, phi), evaluate(dataset, None, psi), PREDICTORS)


def combine(one: Evaluation, other: Evaluation, order: Sequence[str]) -> Evaluation:
    """Return two evaluations on the same episodes as one, with its predictors in order; the first takes precedence."""

    def merge(first: Mapping[str, Kept], second: Mapping[str, Kept]) -> dict[str, Kept]:
        both = {**second, **first}
        return {name: both[name] for name in order if name in both}

    return Evaluation(
        merge(one.one_step, other.one_step),
        merge(one.open_loop, other.open_loop),
        merge(one.rollouts, other.rollouts),
        {**other.diverged, **one.diverged},
    )
