"""A recording: one episode of a log in SI units, row by row as it was recorded."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np


@dataclass(frozen=True)
class Recording:
    """One episode of N rows and n joints.

    Attributes:
        file: The log it comes from, as the user named it.
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
    def place(self) -> str:
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

    def aligned(self, alignment: str) -> "Recording":
        """Return the recording with each command in the row of the last state measured before it acts.

        Args:
            alignment: `action_follows_state` (rows are so already) or `state_follows_action` (a row's state is the
                answer to its command, which therefore belongs to the row before; the last row has no command).
        """
        if alignment == "action_follows_state":
            return self
        return replace(self.take(slice(None, -1)), commands=self.commands[1:])
