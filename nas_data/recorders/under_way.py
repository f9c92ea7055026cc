"""A recording that is under way: where it grows, what is said of it when it stops, and how it becomes a dataset."""

from dataclasses import replace
from pathlib import Path

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.incremental_writer import Growing
from nas_data.dataset.provenance import now, read_provenance
from nas_data.dataset.versions import FOLDER, save
from nas_data.errors import OptionError

SAVING = 10.0  # [s] that the disk may take for an episode while the arm stands still


def place(name: str, out: Path | None = None) -> Path:
    """Return where a recording grows until it is complete.

    Args:
        name: Of the dataset that it becomes.
        out: The dataset's folder, where it is to have a certain one.
    """
    return out.with_name(f"{out.name}.recording") if out else FOLDER / name / "recording"


def describe_progress(root: Path, count: int, wanted: int) -> str:
    """Say how many episodes of how many are saved, and how it goes on."""
    if not count:
        return "Nothing was recorded yet."
    return f"{count} of {wanted} episodes are saved in {root}; the same command goes on from there."


def other_recording_error(root: Path, what: str, option: str = "--name") -> OptionError:
    """Return the refusal to go on with a recording of something else.

    Args:
        root: Where it grows.
        what: In what it differs.
        option: By which another name is given.
    """
    return OptionError(
        f"{root} was begun with {what}; give the same to go on, --finish to make a dataset of it, or another {option}."
    )


def complete(growing: Growing, dataset: Dataset, notes: str = "", *, name: str, out: Path | None = None) -> Path:
    """Make a dataset of what is saved, and remove the recording.

    Args:
        growing: The recording.
        dataset: What it holds.
        notes: For people.
        name: The next version of `datasets/<name>`.
        out: Exactly this folder instead.

    Returns:
        The dataset's folder.
    """
    provenance = read_provenance(growing.root)
    assert provenance is not None
    path = save(dataset, replace(provenance, when=now(), files={}, notes=notes), out=out, name=name)
    growing.remove()
    return path
