"""The work of `nas record sim` and `nas pair` that benchmarks time, including the files."""

from pathlib import Path

from nas_data.api.pairing import pair
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.origin import describe
from nas_data.dataset.versions import save


def write_version(dataset: Dataset, out: Path) -> Path:
    """Write a dataset with its provenance and its source; return the folder."""
    provenance, kept = describe(dataset)
    return save(dataset, provenance, out=out, attachments=kept)


def pair_folder(root: Path, model: str, out: Path) -> Path:
    """Pair a recorded dataset with a robot as source; return the folder."""
    return write_version(pair(root, model), out)
