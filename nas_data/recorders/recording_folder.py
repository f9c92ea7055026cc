"""A recording in progress: its folder, its progress message, and its conversion to a dataset."""

from dataclasses import replace
from pathlib import Path

from nas_data.count_of import count_of
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.incremental_writer import IncrementalWriter
from nas_data.dataset.provenance import format_current_time, read_provenance
from nas_data.dataset.versions import FOLDER, save
from nas_data.errors import OptionError

SAVING = 10.0  # [s] allowed for saving an episode while the arm stands still


def choose_recording_folder(name: str, out: Path | None = None) -> Path:
    """Return the folder of a recording in progress.

    Args:
        name: Name of the final dataset.
        out: Folder of the final dataset; the next version of `datasets/<name>` if None.
    """
    return out.with_name(f"{out.name}.recording") if out else FOLDER / name / "recording"


def describe_progress(root: Path, count: int, wanted: int) -> str:
    """Return a sentence on how many of the wanted episodes are saved, and how to resume."""
    if not count:
        return "Nothing was recorded yet."
    return f"{count} of {count_of(wanted, 'episode')} are saved in {root}; run the same command to continue."


def make_other_recording_error(root: Path, what: str, option: str = "--name") -> OptionError:
    """Return the error for a recording that was begun with other settings.

    Args:
        root: Folder of the recording.
        what: The settings that differ, in words.
        option: Command-line option that chooses another name.
    """
    return OptionError(
        f"{root} was started with {what}; give the same to continue, --finish to make a dataset of the saved episodes, "
        f"or another {option}."
    )


def complete(
    growing: IncrementalWriter, dataset: Dataset, notes: str = "", *, name: str, out: Path | None = None
) -> Path:
    """Save the recorded episodes as a dataset, and remove the recording.

    Args:
        growing: The recording.
        dataset: Its content.
        notes: Notes for the provenance.
        name: Name of the dataset; the next version of `datasets/<name>` is written.
        out: Folder to write instead.

    Returns:
        The dataset's folder.
    """
    provenance = read_provenance(growing.root)
    assert provenance is not None
    path = save(dataset, replace(provenance, when=format_current_time(), files={}, notes=notes), out=out, name=name)
    growing.remove()
    return path
