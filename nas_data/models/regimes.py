"""Open-loop errors of source and source + φ by regime: holding, moving slowly, moving fast."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from nas_data.dataset.dataset import Dataset
from nas_data.joint_units import compute_angle_scales, format_table_unit, group_by_kind, list_unit_factors
from nas_data.text_table import align_columns

SPAN = 0.5  # [s] over which speeds are measured: an encoder tick of 0.09° is then 0.2°/s, noise of a resting joint
# Least measured speed of a joint [rad/s]; slides are scaled by `compute_angle_scales`.
REGIMES: Mapping[str, float] = {"holding": 0.0, "slow": math.radians(1.0), "fast": math.radians(20.0)}
NEGLIGIBLE = 1e-4  # [rad; m] errors below it, such as those of joints that never move, are not held against φ
SPEEDS = {"holding": "below 1°/s", "slow": "1 to 20°/s", "fast": "above 20°/s"}


@dataclass(frozen=True)
class RegimeErrors:
    """Root mean squared open-loop position errors in R regimes of the motion of n joints.

    Each joint is at each frame in one regime, by its measured speed.

    Attributes:
        joints: Names of the joints.
        frames: Frames of each regime and joint, shape (R, n).
        source: Mean squared errors of the source [rad²; slides m²], shape (R, n); NaN without frames.
        corrected: Those of source + φ, shape (R, n); NaN without frames, and not finite where it diverged.
        slides: Names of the joints that are slides.
    """

    joints: tuple[str, ...]
    frames: np.ndarray
    source: np.ndarray
    corrected: np.ndarray
    slides: frozenset[str] = frozenset()

    @classmethod
    def of(cls, dataset: Dataset, source: Sequence[np.ndarray], corrected: Sequence[np.ndarray]) -> "RegimeErrors":
        """Compare rollouts with the measured episodes.

        Args:
            dataset: Episodes of n joints.
            source: States of the source in open loop, for each episode shape (T, 2n).
            corrected: States of source + φ, shapes as of `source`.
        """
        n = len(dataset.joints)
        measured = [dataset.next_states[rows, :n].astype(float) for rows in dataset.episodes()]
        scales = compute_angle_scales(dataset.joints, dataset.slides, np.ptp(np.concatenate(measured), axis=0))
        speeds = np.concatenate([measure_speeds(positions, dataset.fps) for positions in measured]) / scales
        regimes = np.digitize(speeds, list(REGIMES.values())) - 1
        masks = np.stack([regimes == number for number in range(len(REGIMES))])
        found = [
            average_where(
                masks, np.square(np.concatenate([states[:, :n] for states in rolled]) - np.concatenate(measured))
            )
            for rolled in (source, corrected)
        ]
        return cls(dataset.joints, masks.sum(axis=1), found[0], found[1], frozenset(dataset.slides))

    def pool(self, squared: np.ndarray) -> np.ndarray:
        """Return RMS errors over all frames of the joints of the first kind, shape (R,); NaN without frames."""
        places = group_by_kind(self.joints, self.slides)[0][1]
        frames = self.frames[:, places]
        sums = np.where(frames > 0, squared[:, places] * frames, 0.0).sum(axis=1)
        count = frames.sum(axis=1)
        return np.sqrt(np.divide(sums, count, out=np.full(len(count), np.nan), where=count > 0))

    @property
    def helps(self) -> dict[str, bool]:
        """Whether φ reduces the error, by regime; regimes without frames are absent."""
        pairs = zip(REGIMES, self.pool(self.source), self.pool(self.corrected), strict=True)
        return {name: bool(after < before) for name, before, after in pairs if not np.isnan(before)}

    def find_harmed_joints(self) -> dict[str, list[str]]:
        """Return the joints whose error φ does not reduce, by regime with such joints."""
        worse = (self.frames > 0) & ~((self.corrected < self.source) | (self.corrected < NEGLIGIBLE**2))
        return {
            name: [self.joints[place] for place in np.flatnonzero(row)]
            for name, row in zip(REGIMES, worse, strict=True)
            if row.any()
        }

    def text(self) -> str:
        """Return a table of both errors, and a sentence on where φ helps and where not."""
        factors = list_unit_factors(self.joints, self.slides)
        first = group_by_kind(self.joints, self.slides)[0]
        pooled = first[0].factor * np.stack([self.pool(self.source), self.pool(self.corrected)], axis=1)
        shares = self.frames.sum(axis=1) / self.frames.sum()
        rows = [["", "frames", *self.joints, "all"]]
        for number, name in enumerate(REGIMES):
            before, after = factors * np.sqrt(self.source[number]), factors * np.sqrt(self.corrected[number])
            cells = [format_change(*pair) for pair in zip(before, after, strict=True)]
            rows.append([f"{name} ({SPEEDS[name]})", f"{shares[number]:.0%}", *cells, format_change(*pooled[number])])
        title = "Open loop by measured speed of the joint: RMSE of positions, source → source + φ"
        lines = align_columns(rows, least=7)
        heading = f"{title} [{format_table_unit(self.joints, self.slides)}]"
        return "\n".join([heading, *(f"  {line}" for line in lines), *self.list_findings()])

    def list_findings(self) -> list[str]:
        """Return sentences on the regimes in which φ helps, and on joints where it does not."""
        helped = [name for name, helps in self.helps.items() if helps]
        others = [name for name in self.helps if name not in helped]
        where = f"φ reduces the error in: {', '.join(helped) or 'no regime'}."
        lines = [where + (f" It does not in: {', '.join(others)}." if others else "")]
        harmed = [f"{name}: {', '.join(joints)}" for name, joints in self.find_harmed_joints().items()]
        return lines + ([f"Joints whose error φ does not reduce: {'; '.join(harmed)}."] if harmed else [])

    def to_json(self) -> dict[str, object]:
        """Return frames and errors [rad; slides m] by regime and joint; None without frames or after divergence."""
        return {
            name: {
                "speed": SPEEDS[name],
                "helps": self.helps.get(name),
                "frames": dict(zip(self.joints, self.frames[number].tolist(), strict=True)),
                "source": self._name_joints(self.source, number),
                "corrected": self._name_joints(self.corrected, number),
            }
            for number, name in enumerate(REGIMES)
        }

    def _name_joints(self, squared: np.ndarray, number: int) -> dict[str, float | None]:
        """Return the RMS errors of one regime by joint, and of all joints of the first kind as `all`."""
        values = [*np.sqrt(squared[number]).tolist(), float(self.pool(squared)[number])]
        return {
            name: value if math.isfinite(value) else None
            for name, value in zip((*self.joints, "all"), values, strict=True)
        }


def measure_speeds(positions: np.ndarray, rate: float) -> np.ndarray:
    """Return the speeds of joints [rad/s; m/s], shape (T, n), as mean over `SPAN` around each frame.

    Args:
        positions: Measured positions [rad; m], shape (T, n).
        rate: Frames per second [Hz].
    """
    half = max(1, round(SPAN * rate / 2))
    frames = np.arange(len(positions))
    first, last = np.maximum(frames - half, 0), np.minimum(frames + half, len(positions) - 1)
    seconds = np.maximum(last - first, 1)[:, None] / rate
    return np.abs(positions[last] - positions[first]) / seconds


def average_where(masks: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return the means (R, n) of values (T, n) over the frames of masks (R, T, n); NaN without frames."""
    count = masks.sum(axis=1)
    sums = np.where(masks, values, 0.0).sum(axis=1)
    return np.divide(sums, count, out=np.full(count.shape, np.nan), where=count > 0)


def format_change(before: float, after: float) -> str:
    """Return errors before and after as a cell."""
    if np.isnan(before):
        return "–"
    return f"{before:.2f} → {after:.2f}" if np.isfinite(after) else f"{before:.2f} → diverged"
