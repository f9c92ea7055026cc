"""What a baseline reads from a dataset: equally long episodes as arrays."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from nas_data.dataset.read import read


@dataclass(frozen=True)
class RecordedCase:
    """Episodes of a dataset."""

    joints: tuple[str, ...]  # names of the measured joints
    rate: float  # control rate [Hz]
    commands: np.ndarray  # [rad, N m], shape (E, T, n)
    states: np.ndarray  # positions [rad] then velocities [rad/s] before each command and after the last, (E, T + 1, 2n)

    @classmethod
    def load(cls, folder: Path) -> "RecordedCase":
        """Read a dataset whose episodes are equally long, as blind cases are."""
        dataset = read(folder)
        rows = list(dataset.episodes())
        before = np.stack([dataset.states[row] for row in rows]).astype(float)
        last = np.stack([dataset.next_states[row][-1:] for row in rows]).astype(float)
        commands = np.stack([dataset.commands[row] for row in rows]).astype(float)
        return cls(dataset.joints, dataset.fps, commands, np.concatenate([before, last], axis=1))

    @property
    def positions(self) -> np.ndarray:
        """Measured positions [rad], shape (E, T + 1, n)."""
        return self.states[..., : len(self.joints)]
