"""Recorded rows in the layout of an episode batch, with the motion around each."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import TIME
from nas_data.gap.episode_batch import EpisodeBatch, pad_rows

AVERAGING_TIME = 0.05  # [s] on either side of a reading over which its velocity is averaged
RESTING_FLOORS = 4.0  # noise floors; a joint that moves less is at rest; one quantum is √12 floors


@dataclass(frozen=True)
class RecordedRows:
    """E episodes of up to T rows of n joints."""

    evidence: EpisodeBatch  # the same episodes as a batch
    positions: np.ndarray  # positions before each command [rad; m], shape (E, T, n)
    velocities: np.ndarray  # velocities before each command [rad/s; m/s], shape (E, T, n)
    times: np.ndarray | None  # Recorder's clock [s], shape (E, T); None without one

    @classmethod
    def of(cls, dataset: Dataset, evidence: EpisodeBatch) -> "RecordedRows":
        """Read the batch's episodes from its dataset."""
        n, longest = len(dataset.joints), evidence.commands.shape[1]
        rows = [dataset.episode(int(number)) for number in evidence.numbers]
        states = np.stack([pad_rows(dataset.states[part], longest) for part in rows])
        times = None
        if TIME in dataset.columns:
            times = np.stack([pad_rows(dataset.columns[TIME][part], longest)[:, 0] for part in rows])
        return cls(evidence, states[..., :n], states[..., n:], times)

    @cached_property
    def motion(self) -> np.ndarray:
        """Mean velocity around each reading after a command [rad/s; m/s], shape (E, T, n)."""
        return self.moved / (2 * self.reach * self.evidence.period)

    @cached_property
    def moved(self) -> np.ndarray:
        """Change of position around each reading [rad; m], shape (E, T, n)."""
        reach = self.reach
        padded = np.pad(self.evidence.measured, ((0, 0), (reach, reach), (0, 0)), mode="edge")
        return padded[:, 2 * reach :] - padded[:, : -2 * reach]

    @property
    def reach(self) -> int:
        """Number of rows on either side over which a velocity is averaged."""
        return max(1, round(AVERAGING_TIME / self.evidence.period))

    def moving(self, floor: np.ndarray) -> np.ndarray:
        """Return the rows in which a joint moved, for noise floors [rad; m] (n,); shape (E, T, n)."""
        return np.asarray((np.abs(self.moved) > RESTING_FLOORS * floor) & self.evidence.mask[..., None])
