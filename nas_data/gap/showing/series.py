"""Held-out episodes of a report: measured positions and predictions of each model."""

import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from nas_data.errors import OptionError
from nas_data.joint_units import JointUnit, group_by_kind

SMALLEST_DRAWN = 1 / 3  # noise floors; smaller errors are drawn at this value
SERIES = "series.npz"


@dataclass(frozen=True)
class Series:
    """E held-out episodes of up to T rows of n joints, positions [rad], those of slides [m].

    Errors over joints are those of the first kind, hinges if there are any, because radians and metres have no common
    mean.
    """

    time: np.ndarray  # time since the start of an episode [s], shape (T,)
    joints: tuple[str, ...]  # names
    episodes: np.ndarray  # numbers in the dataset, shape (E,)
    measured: np.ndarray  # measured positions, shape (E, T, n)
    command: np.ndarray  # positions [rad; m] or torques [N·m; N], shape (E, T, n)
    before: np.ndarray  # given model
    retuned: np.ndarray  # Model's own parameters fitted, no effects
    after: np.ndarray  # written model
    counts: np.ndarray  # whether a row was recorded, shape (E, T)
    floor: np.ndarray  # noise floor, shape (n,)
    placebo: np.ndarray | None = None  # Runner-up in place of the name; None without one
    plain: np.ndarray | None = None  # plain fit; None in older reports
    slides: tuple[str, ...] = ()  # names of the slides

    @property
    def period(self) -> float:
        """Control period [s]."""
        return float(np.diff(self.time, prepend=0.0).mean())

    @property
    def kinds(self) -> list[tuple[JointUnit, np.ndarray]]:
        """Kinds of joints with their indices; pooled errors are those of the first."""
        return group_by_kind(self.joints, self.slides)

    @property
    def over(self) -> str:
        """Joints of pooled errors with their unit, for an axis."""
        (unit, _), *others = self.kinds
        return f"{unit.kind if others else 'joints'} [{unit.mark.strip()}]"

    def shown(self, values: np.ndarray) -> np.ndarray:
        """Return pooled errors in display units, of the same shape."""
        return np.asarray(self.kinds[0][0].factor * values)

    @classmethod
    def read(cls, folder: Path) -> "Series":
        """Read the series of a folder.

        Raises:
            OptionError: it is missing or incomplete.
        """
        path = folder / SERIES
        return cls.read_file(path, str(path))

    @classmethod
    def read_file(cls, file: Path | BinaryIO, name: str) -> "Series":
        """Read the series from a file, with its name in errors; see `read`."""
        try:
            with np.load(file, allow_pickle=False) as stored:
                parts = {name: stored[name] for name in stored.files if name in cls.__dataclass_fields__}
            parts |= {key: tuple(map(str, parts[key])) for key in ("joints", "slides") if key in parts}
            return cls(**parts)
        except (OSError, ValueError, TypeError, KeyError, zipfile.BadZipFile) as error:
            raise OptionError(
                f"{name} has no series to draw ({error}); make it again with: nas gap DATASET --model MODEL --out DIR"
            ) from None

    def squares(self, predicted: np.ndarray) -> np.ndarray:
        """Return the mean squared error of each episode and joint [rad²; m²], shape (E, n)."""
        errors = np.where(self.counts[..., None], predicted - self.measured, 0.0)
        return np.asarray((errors**2).sum(1) / self.counts.sum(1)[:, None])

    def by_joint(self, predicted: np.ndarray) -> np.ndarray:
        """Return the RMSE of each joint over the episodes [rad; m], shape (n,)."""
        return np.asarray(np.sqrt(self.squares(predicted).mean(0)))

    def drawn_by_joint(self, predicted: np.ndarray) -> np.ndarray:
        """Return the error of each joint for a logarithmic axis [rad; m], shape (n,).

        Errors of a joint that never moved are rounding errors; they stand at a share of its floor.
        """
        return np.maximum(self.by_joint(predicted), SMALLEST_DRAWN * self.floor)

    def by_episode(self, predicted: np.ndarray) -> np.ndarray:
        """Return the RMSE of each episode over the joints of the first kind, shape (E,)."""
        return np.asarray(np.sqrt(self.squares(predicted)[:, self.kinds[0][1]].mean(1)))

    def worst_episode(self, joint: int) -> int:
        """Return the index of the held-out episode with the largest error of the given model at a joint."""
        return int(self.squares(self.before)[:, joint].argmax())

    def in_time(self, predicted: np.ndarray, window: float) -> np.ndarray:
        """Return the RMS error over joints of the first kind and a window [s], shape (E, T); NaN after the end."""
        errors = np.where(self.counts[..., None], predicted - self.measured, 0.0)
        width = max(1, min(len(self.time), round(window / self.period)))
        box = np.ones(width)
        sums = np.stack([np.convolve(row, box, "same") for row in (errors[..., self.kinds[0][1]] ** 2).mean(-1)])
        rows = np.stack([np.convolve(row, box, "same") for row in self.counts.astype(float)])
        return np.where(self.counts, np.sqrt(np.maximum(sums, 0.0) / np.maximum(rows, 1.0)), np.nan)

    @property
    def overall_floor(self) -> float:
        """Noise floor over joints of the first kind."""
        return float(np.sqrt((self.floor[self.kinds[0][1]] ** 2).mean()))
