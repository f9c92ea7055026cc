"""Errors of predicted against measured joint positions, in physical units."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Errors:
    """Root mean squared position errors [rad] of one predictor on E episodes of n joints.

    Attributes:
        joints: Names of the joints.
        squared: Mean squared error of each episode and joint [rad²], shape (E, n); NaN where it diverged.
        lengths: Frames of each episode, shape (E,).
    """

    joints: tuple[str, ...]
    squared: np.ndarray
    lengths: np.ndarray

    @classmethod
    def of(cls, joints: Sequence[str], predicted: Sequence[np.ndarray], measured: Sequence[np.ndarray]) -> "Errors":
        """Compare episodes.

        Args:
            joints: Names of the n joints.
            predicted: Predicted states or positions of each episode, shape (T, ≥n); the first n components count.
            measured: The same, measured.
        """
        n = len(joints)
        pairs = list(zip(predicted, measured, strict=True))
        squared = np.array([np.square(p[:, :n].astype(float) - m[:, :n]).mean(axis=0) for p, m in pairs])
        return cls(tuple(joints), squared.reshape(len(pairs), n), np.array([len(m) for _, m in pairs]))

    @property
    def overall(self) -> float:
        """RMSE over all frames and joints [rad]."""
        return float(np.sqrt(np.average(self.squared.mean(axis=1), weights=self.lengths)))

    @property
    def per_joint(self) -> dict[str, float]:
        """RMSE of each joint over all frames [rad]."""
        values = np.sqrt(np.average(self.squared, axis=0, weights=self.lengths))
        return dict(zip(self.joints, values.tolist(), strict=True))

    @property
    def per_episode(self) -> list[float]:
        """RMSE of each episode over its joints [rad]."""
        return np.sqrt(self.squared.mean(axis=1)).tolist()

    @property
    def mean_of_episodes(self) -> float:
        """Mean of the episodes' RMSE [rad]: every episode counts alike, however long."""
        return float(np.mean(self.per_episode))

    def to_json(self) -> dict[str, object]:
        """Return all of it, per episode also by joint."""
        rows = [dict(zip(self.joints, np.sqrt(row).tolist(), strict=True)) for row in self.squared]
        return {
            "overall": self.overall,
            "mean_of_episodes": self.mean_of_episodes,
            "per_joint": self.per_joint,
            "per_episode": self.per_episode,
            "per_episode_and_joint": rows,
        }


def table(rows: Mapping[str, Errors], title: str) -> str:
    """Return a table of RMSE in degrees: a row per predictor, a column per joint, the mean of episodes last.

    A predictor that diverges in any episode has no mean error; its row says so.
    """
    joints = next(iter(rows.values())).joints
    widths = [max(7, len(joint)) for joint in joints]
    names = max(len(name) for name in rows)
    head = "  ".join(f"{joint:>{width}}" for joint, width in zip(joints, widths, strict=True))
    lines = [f"{title} [deg]", f"  {'':<{names}}  {head}      all  mean of episodes"]
    for name, errors in rows.items():
        if not np.isfinite(errors.overall):
            lines.append(f"  {name:<{names}}  {'diverged':>{len(lines[1]) - names - 4}}")
            continue
        values = np.degrees(list(errors.per_joint.values()))
        cells = "  ".join(f"{value:{width}.3f}" for value, width in zip(values, widths, strict=True))
        overall, mean = np.degrees([errors.overall, errors.mean_of_episodes])
        lines.append(f"  {name:<{names}}  {cells}  {overall:7.3f}  {mean:16.3f}")
    return "\n".join(lines)
