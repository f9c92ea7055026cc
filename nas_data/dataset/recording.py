"""A recording: one episode of a log or dataset in SI units, row by row as recorded."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import TIME
from nas_data.dataset.rows import TextLines, format_rows
from nas_data.dataset.start_velocities import detect_derived_velocities

SIGNAL = "nas."  # prefix of the keys of further signals


@dataclass(frozen=True)
class Recording:
    """One episode of N rows and n joints.

    Attributes:
        file: Path of the log as the user gave it, or the episode of a dataset.
        episode: Name of the episode in the log; empty if the log is one episode.
        joints: Joint names.
        time: Recorder's time since the first row [s], shape (N,).
        positions: Measured positions [rad], shape (N, n).
        velocities: Measured velocities [rad/s], shape (N, n); None if the log has none.
        commands: Commanded positions [rad] or torques [N·m], shape (N, n).
        signals: Other signals, shape (N, n) or (N, 1) each.
        rows: Row number in the log of each row, counted from 0, shape (N,).
        constants: Values that the log holds once.
        gap: Gap in the log before the first row [s]; 0 if there is none.
        lines: Lines of the log's text file by row number; None for other logs.
    """

    file: str
    episode: str
    joints: tuple[str, ...]
    time: np.ndarray
    positions: np.ndarray
    velocities: np.ndarray | None
    commands: np.ndarray
    signals: Mapping[str, np.ndarray]
    rows: np.ndarray
    constants: Mapping[str, object] = field(default_factory=dict)
    gap: float = 0.0
    lines: TextLines | None = None

    @property
    def label(self) -> str:
        """Name for messages: the log, and its episode if it holds several."""
        return f"{self.file}:{self.episode}" if self.episode else self.file

    @property
    def log(self) -> str:
        """Name of the log, and of its episode if it holds several."""
        stem = Path(self.file).stem
        return f"{stem}:{self.episode}" if self.episode else stem

    def __len__(self) -> int:
        return len(self.time)

    def name_rows(self, rows: Sequence[int] | np.ndarray) -> str:
        """Return row numbers of the log as words for messages; see `format_rows`."""
        return format_rows(rows, self.lines)

    def take(self, chosen: np.ndarray | slice) -> "Recording":
        """Return the given rows; the time starts at the first of them."""
        time = self.time[chosen]
        return replace(
            self,
            time=time - time[0] if len(time) else time,
            positions=self.positions[chosen],
            velocities=None if self.velocities is None else self.velocities[chosen],
            commands=self.commands[chosen],
            signals={key: values[chosen] for key, values in self.signals.items()},
            rows=self.rows[chosen],
        )

    def align(self, alignment: str) -> "Recording":
        """Return the recording with each command in the row of the last state measured before it acts.

        Args:
            alignment: `action_follows_state` leaves the rows unchanged. With `state_follows_action` a row's state is
                the response to its command, so commands move one row up, and the last row is dropped.
        """
        if alignment == "action_follows_state":
            return self
        return replace(self.take(slice(None, -1)), commands=self.commands[1:])


def extract_recordings(dataset: Dataset) -> Iterator[Recording]:
    """Iterate over the episodes of a dataset as recordings.

    Args:
        dataset: States and commands of named joints. Velocities derived from positions are left out. Without a
            recorder's clock the rows are evenly spaced.
    """
    n = len(dataset.joints)
    measured = dataset.states.shape[1] == 2 * n and not has_derived_velocities(dataset)
    signals = {
        key.removeprefix(SIGNAL): column
        for key, column in dataset.columns.items()
        if key.startswith(SIGNAL) and key != TIME and column.dtype.kind in "bfiu"
    }
    for index, frames in enumerate(dataset.episodes()):
        count = frames.stop - frames.start
        even = np.arange(count) / dataset.fps
        time = dataset.columns[TIME][frames, 0].astype(np.float64) if TIME in dataset.columns else even
        states = dataset.states[frames].astype(np.float64)
        yield Recording(
            file=f"episode {index}",
            episode="",
            joints=dataset.joints,
            time=time,
            positions=states[:, :n],
            velocities=states[:, n:] if measured else None,
            commands=dataset.commands[frames].astype(np.float64),
            signals={name: column[frames] for name, column in signals.items()},
            rows=np.arange(count),
        )


def has_derived_velocities(dataset: Dataset) -> bool:
    """Whether the velocities of a dataset with 2n-states were computed from its positions."""
    n = len(dataset.joints)
    if not np.isfinite(dataset.states).all():
        return False
    episodes = [dataset.states[frames].astype(np.float64) for frames in dataset.episodes()]
    return bool(
        detect_derived_velocities(
            [rows[:, :n] for rows in episodes], [rows[:, n:] for rows in episodes], dataset.fps
        ).all()
    )
