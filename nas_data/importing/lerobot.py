"""A dataset that LeRobot recorded, brought into the contract's form: velocities and next states are derived."""

from pathlib import Path

from nas_data.dataset import layout
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.provenance import Provenance, read_provenance
from nas_data.dataset.read import read
from nas_data.dataset.transitions import as_transitions
from nas_data.dataset.versions import parent_of
from nas_data.errors import OptionError


def is_dataset(path: Path) -> bool:
    """Return whether a path is a dataset's folder."""
    return (path / layout.INFO).is_file()


def import_dataset(path: Path) -> tuple[Dataset, Provenance]:
    """Read a dataset of LeRobot's keys as transitions.

    Args:
        path: Its folder.

    Raises:
        OptionError: it is one of ours already.
        DatasetInvalid, JointMismatch: it cannot be used.
    """
    if read_provenance(path) is not None:
        raise OptionError(f"{path} is a dataset of nas already; use it as it is (nas info, nas pair, nas gap).")
    recorded = read(path)
    dataset, derived = as_transitions(recorded)
    provenance = Provenance(
        how="imported",
        robot=dataset.robot_type,
        target={"kind": "LeRobot dataset"},
        parents=(parent_of(path, recorded),),
        derived=derived,
        contiguous=True,
    )
    return dataset, provenance
