"""Crash-safe writer of a dataset, episode by episode.

The folder is a valid LeRobot dataset of the saved episodes at every moment, even if the writer is killed. It is a
symbolic link. Saving creates a second folder with hard links to the old files and with the new files, and then one
rename redirects the link.
"""

import glob
import os
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np

from nas_data.dataset import layout
from nas_data.dataset.content import convert_column
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.info import DatasetInfo
from nas_data.dataset.provenance import Provenance
from nas_data.dataset.read import read_tasks
from nas_data.dataset.staging import flush_folder, refuse_existing, write_synced
from nas_data.dataset.statistics import compute_statistics
from nas_data.dataset.write import (
    encode_json,
    encode_parquet,
    fill,
    make_automatic_columns,
    make_data_file,
    make_episode_table,
    make_info,
    make_number_array,
)
from nas_data.errors import DatasetInvalid
from nas_data.typed_json import as_object

REWRITTEN = {layout.INFO, layout.STATS, layout.CARD, layout.PROVENANCE}


class IncrementalWriter:
    """Writes a recording in progress.

    Attributes:
        root: The folder; absent until the first episode is saved.
    """

    def __init__(self, root: Path) -> None:
        """Resume or begin a recording; unfinished files of a killed writer are removed.

        Raises:
            OutputExists: the path holds something else.
        """
        self.root = root
        if not root.is_symlink():
            refuse_existing(root)
        for folder in self._list_generations():
            if not root.is_symlink() or folder.resolve() != root.resolve():
                shutil.rmtree(folder)

    @property
    def episodes(self) -> int:
        """Number of saved episodes."""
        return DatasetInfo.read(self.root).total_episodes if self.root.is_symlink() else 0

    def append(self, episodes: Dataset, provenance: Provenance, attachments: dict[str, bytes] | None = None) -> None:
        """Save episodes atomically and flush them to the disk.

        Args:
            episodes: At least one episode; features and task are equal in all calls.
            provenance: Origin of the episodes.
            attachments: Extra files by path, stored with the first episodes.
        """
        number = self.episodes
        self.root.parent.mkdir(parents=True, exist_ok=True)
        folder = self._make_generation_path(number + episodes.n_episodes)
        shutil.rmtree(folder, ignore_errors=True)
        if number:
            self._extend(folder, episodes, provenance)
        else:
            fill(folder, episodes, provenance, attachments or {})
            (folder / layout.STATS).unlink()  # overall statistics are computed at the end
        for path in [folder, *(path for path in folder.rglob("*") if path.is_dir())]:
            flush_folder(path)
        self._redirect_link(folder)
        if number:
            shutil.rmtree(self._make_generation_path(number), ignore_errors=True)

    def remove(self) -> None:
        """Delete the recording, after it was saved as a dataset."""
        self.root.unlink(missing_ok=True)
        for folder in self._list_generations():
            shutil.rmtree(folder)

    def _extend(self, folder: Path, episodes: Dataset, provenance: Provenance) -> None:
        """Create a folder of the old files and the new episodes."""
        info = DatasetInfo.read(self.root)
        number, rows = info.total_episodes, info.total_frames
        features, tasks = info.vector_features, list(read_tasks(self.root).values())
        if features != dict(episodes.features) or [*dict.fromkeys(episodes.tasks)] != tasks:
            raise DatasetInvalid(
                f"{self.root} has other features or another task than the episode to be added; choose another name."
            )
        _link(self.root.resolve(), folder)
        columns = {key: convert_column(episodes, key) for key in episodes.features}
        columns |= make_automatic_columns(episodes, tasks)
        columns["episode_index"] = columns["episode_index"] + number
        columns["index"] = columns["index"] + rows
        content = make_data_file(columns, episodes, range(episodes.n_episodes))
        write_synced(folder / layout.make_numbered_path(layout.DATA_TEMPLATE, number), content)
        write_synced(
            folder / layout.make_numbered_path(layout.EPISODES_TEMPLATE, number),
            self._make_episode_file(episodes, columns, number, rows),
        )
        count, frames = number + episodes.n_episodes, rows + episodes.n_frames
        whole = make_info(episodes, info.total_tasks)
        whole = replace(whole, total_episodes=count, total_frames=frames, splits={"train": f"0:{count}"})
        write_synced(folder / layout.INFO, encode_json(as_object(whole)))
        write_synced(folder / layout.PROVENANCE, encode_json(replace(provenance, files={}).to_json()))

    def _make_episode_file(
        self, episodes: Dataset, columns: dict[str, np.ndarray], number: int, rows: int
    ) -> memoryview:
        """Return the new file of the episode table."""
        table = make_episode_table(
            episodes, [range(episodes.n_episodes)], compute_statistics(columns, episodes.lengths)
        )
        chunk, file = (np.full(episodes.n_episodes, part) for part in divmod(number, layout.FILES_PER_CHUNK))
        first = rows + episodes.starts
        places: dict[str, np.ndarray] = {"data/chunk_index": chunk, "data/file_index": file}
        places["episode_index"] = number + np.arange(episodes.n_episodes)
        places |= {"dataset_from_index": first, "dataset_to_index": first + episodes.lengths}
        for key, values in places.items():
            table = table.set_column(table.column_names.index(key), key, make_number_array(values))
        for key, values in {"meta/episodes/chunk_index": chunk, "meta/episodes/file_index": file}.items():
            table = table.append_column(key, make_number_array(values))
        return encode_parquet(table)

    def _redirect_link(self, folder: Path) -> None:
        """Redirect the link to another folder atomically."""
        link = self.root.with_name(f".{self.root.name}.link")
        link.unlink(missing_ok=True)
        link.symlink_to(folder.name)
        link.rename(self.root)
        flush_folder(self.root.parent)

    def _make_generation_path(self, episodes: int) -> Path:
        return self.root.with_name(f".{self.root.name}-{episodes:06d}")

    def _list_generations(self) -> list[Path]:
        return sorted(self.root.parent.glob(f".{glob.escape(self.root.name)}-[0-9]*"))


def _link(old: Path, new: Path) -> None:
    """Hard-link all unchanged files into a new folder."""
    for path in old.rglob("*"):
        name = path.relative_to(old)
        if path.is_file() and name.as_posix() not in REWRITTEN:
            (new / name).parent.mkdir(parents=True, exist_ok=True)
            os.link(path, new / name)
