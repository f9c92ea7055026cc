"""A folder of datasets as a user has it, and first versions in it."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
from hypothesis import settings
from support.dataset_samples import recorded

from nas_data.dataset.content import hash_content
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.derive_provenance import Original
from nas_data.dataset.layout import PROVENANCE
from nas_data.dataset.provenance import Provenance
from nas_data.dataset.read import read
from nas_data.dataset.versions import write_version

SIMULATED = Provenance(how="simulated", robot="ergojr", seeds=(3,), contiguous=True, signal={"name": "steps"})
FEW = settings(max_examples=10, deadline=None)


def original(dataset, provenance=SIMULATED, attachments=None, name=None):
    """Write a dataset as the first version of a name and open it."""
    name = name or f"d{hash_content(dataset)[:6]}"
    return Original.read(write_version(dataset, name, provenance, Path("datasets"), attachments))


def changing_task(row: int = 8) -> Dataset:
    """Return a dataset of 12 frames whose task changes within an episode."""
    tasks = np.array(["walk"] * row + ["run"] * (12 - row), object)
    return replace(recorded(lengths=(6, 6), tasks=("walk",)), frame_tasks=tasks)


def write_earlier_version(name: str, row: int = 8) -> Path:
    """Write a dataset as earlier versions of nas did, whose content hash does not cover the tasks of frames."""
    root = write_version(changing_task(row), name, SIMULATED, Path("datasets"))
    stored = json.loads((root / PROVENANCE).read_text())
    stored["content_hash"] = hash_content(read(root), frame_tasks=False)
    (root / PROVENANCE).write_text(json.dumps(stored))
    return root.rename(root.with_name(f"v1-{stored['content_hash'][:8]}"))


def write_some(folder: str, worker: int) -> None:
    """Write three versions of a worker's own, and one that all workers write."""
    for seed in (10 * worker, 10 * worker + 1, 10 * worker + 2, 999):
        write_version(recorded(seed=seed), "arm", SIMULATED, Path(folder))
