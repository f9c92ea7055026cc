"""Training φ and ψ on a paired dataset in a folder: done once, gone on with where it was interrupted."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from nas_data.dataset import versions
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.read import read
from nas_data.models.lstm import Kind
from nas_data.models.presets import TrainingOptions
from nas_data.models.run import HISTORY, STATE, TrainingRun
from nas_data.models.training import Training
from nas_data.sources import find_source, kept_files


@dataclass(frozen=True)
class ModelJob:
    """One model to be trained.

    Attributes:
        kind: `delta` for φ, `forward` for ψ.
        dataset: Folder of the pairs, with their source.
        options: Of the training.
        folder: Where it goes.
    """

    kind: Kind
    dataset: Path
    options: TrainingOptions
    folder: Path


def train_model(
    job: ModelJob, report: Callable[[str], None], choose: Callable[[Dataset], Dataset] = lambda whole: whole
) -> list[dict[str, float]]:
    """Train a model, or go on with its training.

    Args:
        job: What to train on what.
        report: Told a line a validation.
        choose: Which part of the dataset is learned from.

    Returns:
        Its history: a row a validation.
    """
    history = job.folder / HISTORY
    if not history.is_file() or (job.folder / STATE).exists():
        dataset = read(job.dataset)
        source = find_source(None, (), dataset, [job.dataset])
        parent = versions.parent_of(job.dataset, dataset)
        provenance = {
            "dataset": {"name": parent.name, "content_hash": parent.content_hash},
            "source": source.describe(),
        }
        training = Training(job.kind, choose(dataset), job.options, source, provenance)
        TrainingRun(training, job.folder, report, kept_files(job.dataset)).run()
    rows: list[dict[str, float]] = json.loads(history.read_text(encoding="utf-8"))
    return rows
