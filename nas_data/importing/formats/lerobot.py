"""LeRobot: a dataset in LeRobot's format, with named components and a task per episode."""

from pathlib import Path

import numpy as np

from nas_data.dataset.layout import INFO
from nas_data.dataset.read import read as read_dataset
from nas_data.dataset.read import read_stamps
from nas_data.dataset.versions import list_versions, resolve
from nas_data.importing.layout import LogLayout
from nas_data.importing.table import LogTable

SUFFIXES = ()
FOLDER = "a LeRobot dataset"


def is_log(path: Path) -> bool:
    """Return whether a folder is a LeRobot dataset."""
    return (path / INFO).is_file() or bool(list_versions(path))


def read(path: Path, layout: LogLayout) -> LogTable:
    """Read a dataset's vectors and time stamps, and index and task of each row's episode."""
    root = resolve(path)
    dataset = read_dataset(root)
    columns: dict[str, np.ndarray] = {key: np.asarray(column) for key, column in dataset.columns.items()}
    columns["timestamp"] = read_stamps(root)[:, 0]
    columns["episode_index"] = np.repeat(np.arange(dataset.n_episodes), dataset.lengths)
    columns["task"] = np.repeat(np.array(dataset.tasks, dtype=object), dataset.lengths)
    names = {key: feature.names for key, feature in dataset.features.items()}
    return LogTable(path, columns, {"fps": dataset.fps, "robot_type": dataset.robot_type}, names=names)
