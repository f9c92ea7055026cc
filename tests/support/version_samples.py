"""A folder of datasets as a user has it, and first versions in it."""

from pathlib import Path

from hypothesis import settings
from support.dataset_samples import recorded

from nas_data.dataset.content import hash_content
from nas_data.dataset.derive_provenance import Original
from nas_data.dataset.provenance import Provenance
from nas_data.dataset.versions import write_version

SIMULATED = Provenance(how="simulated", robot="ergojr", seeds=(3,), contiguous=True, signal={"name": "steps"})
FEW = settings(max_examples=10, deadline=None)


def original(dataset, provenance=SIMULATED, attachments=None, name=None):
    """Write a dataset as the first version of a name and open it."""
    name = name or f"d{hash_content(dataset)[:6]}"
    return Original.read(write_version(dataset, name, provenance, Path("datasets"), attachments))


def write_some(folder: str, worker: int) -> None:
    """Write three versions of a worker's own, and one that all workers write."""
    for seed in (10 * worker, 10 * worker + 1, 10 * worker + 2, 999):
        write_version(recorded(seed=seed), "arm", SIMULATED, Path(folder))
