"""A recording: one episode in SI units, row by row as it was recorded, of a log or of a dataset."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import TIME
from nas_data.dataset.start_velocities import derived_velocities

SIGNAL = "nas."  # how the keys of further signals begin


@dataclass(frozen=True)
class Recording:
    """One episode of N rows and n joints.

    Attributes:
        file: The log it comes from, as the user named it, or the episode of a dataset.
        episode: Which of the log's episodes; empty where it holds one.
        joints: Joint names.
        time: Recorder's time since the first row [s], shape (N,).
        positions: Measured positions [rad], shape (N, n).
        velocities: Measured velocities [rad/s], shape (N, n); None where the log has none.
        commands: Commanded positions [rad] or torques [N·m], shape (N, n).
        signals: What else is kept, shape (N, n) or (N, 1) each.
        rows: Row of the log for each row here, shape (N,).
        constants: What the log holds once.
        gap: Time that the log lacks before the first row [s]; zero where no hole divided it there.
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

    @property
    def label(self) -> str:
        """Where the rows are found: the log, and the episode where it holds several."""
        return f"{self.file}:{self.episode}" if self.episode else self.file

    @property
    def log(self) -> str:
        """Name of the log, and the episode where it holds several."""
        stem = Path(self.file).stem
        return f"{stem}:{self.episode}" if self.episode else stem

    def __len__(self) -> int:
        return len(self.time)

    def take(self, chosen: np.ndarray | slice) -> "Recording":
        """Return some of the rows; the time starts at the first of them."""
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
            alignment: `action_follows_state` (rows are so already) or `state_follows_action` (a row's state is the
                answer to its command, which therefore belongs to the row before; the last row has no command).
        """
        if alignment == "action_follows_state":
            return self
        return replace(self.take(slice(None, -1)), commands=self.commands[1:])


def recordings(dataset: Dataset) -> Iterator[Recording]:
    """Iterate over the episodes of a dataset as recordings.

    Args:
        dataset: States and commands of named joints. Velocities that were computed from the positions say nothing
            about a register and are left out; without a recorder's clock the rows count as evenly spaced.
    """
    n = len(dataset.joints)
    measured = dataset.states.shape[1] == 2 * n and not are_derived(dataset)
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


def are_derived(dataset: Dataset) -> bool:
    """Whether the velocities of a dataset with 2n-states were computed from its positions."""
    n = len(dataset.joints)
    if not np.isfinite(dataset.states).all():
        return False
    episodes = [dataset.states[frames].astype(np.float64) for frames in dataset.episodes()]
    return bool(
        derived_velocities([rows[:, :n] for rows in episodes], [rows[:, n:] for rows in episodes], dataset.fps).all()
    )
