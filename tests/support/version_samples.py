"""A folder of datasets as a user has it, and first versions in it."""

from pathlib import Path

from hypothesis import settings

from nas_data.dataset.content import content_hash
from nas_data.dataset.derive_provenance import Original
from nas_data.dataset.provenance import Provenance
from nas_data.dataset.versions import new_version

SIMULATED = Provenance(how="simulated", robot="ergojr", seeds=(3,), contiguous=True, signal={"name": "steps"})
FEW = settings(max_examples=10, deadline=None)


def original(dataset, provenance=SIMULATED, attachments=None, name=None):
    """Write a dataset as the first version of a name and open it."""
    name = name or f"d{content_hash(dataset)[:6]}"
    return Original.read(new_version(dataset, name, provenance, Path("datasets"), attachments))
