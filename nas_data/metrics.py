"""Errors of predicted against measured joint positions, in physical units."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from nas_data.count_of import count_of
from nas_data.joint_units import JointUnit, format_table_unit, group_by_kind, list_unit_factors
from nas_data.text_table import align_columns


@dataclass(frozen=True, repr=False)
class Errors:
    """Root mean squared position errors [rad; slides m] of one predictor on E episodes of n joints.

    Degrees and millimetres are never averaged. Overall figures are over the hinges, or over the slides of an arm
    without hinges; `overall_by_kind` has both.

    Attributes:
        joints: Names of the joints.
        squared: Mean squared error of each episode and joint [rad²; m²], shape (E, n); NaN where it diverged.
        lengths: Frames of each episode, shape (E,).
        slides: Names of the joints that are slides.
    """

    joints: tuple[str, ...]
    squared: np.ndarray
    lengths: np.ndarray
    slides: frozenset[str] = frozenset()

    def __repr__(self) -> str:
        """Return the overall error in one line."""
        found = ", ".join(f"{value:.3g} {unit.si}" for unit, value in self.overall_by_kind)
        return f"Errors({found} over {count_of(len(self.lengths), 'episode')})"

    @classmethod
    def of(
        cls,
        joints: Sequence[str],
        predicted: Sequence[np.ndarray],
        measured: Sequence[np.ndarray],
        slides: Collection[str] = (),
    ) -> "Errors":
        """Compute the errors of predicted episodes.

        Args:
            joints: Names of the n joints.
            predicted: Predicted states or positions of each episode, shape (T, ≥n); the first n components count.
            measured: Measured states or positions, shapes as of `predicted`.
            slides: Names of the slides.
        """
        n = len(joints)
        pairs = list(zip(predicted, measured, strict=True))
        squared = np.array([np.square(p[:, :n].astype(float) - m[:, :n]).mean(axis=0) for p, m in pairs])
        return cls(
            tuple(joints), squared.reshape(len(pairs), n), np.array([len(m) for _, m in pairs]), frozenset(slides)
        )

    @property
    def kinds(self) -> list[tuple[JointUnit, np.ndarray]]:
        """Kinds of joints present, each with the indices of its joints; the kind of the overall figures comes first."""
        return group_by_kind(self.joints, self.slides)

    @property
    def unit(self) -> JointUnit:
        """Unit of the overall figures."""
        return self.kinds[0][0]

    @property
    def overall_by_kind(self) -> list[tuple[JointUnit, float]]:
        """RMSE over all frames of the joints of each kind, in SI units."""
        return [
            (unit, float(np.sqrt(np.average(self.squared[:, places].mean(axis=1), weights=self.lengths))))
            for unit, places in self.kinds
        ]

    @property
    def overall(self) -> float:
        """RMSE over all frames and all joints of the first kind."""
        return self.overall_by_kind[0][1]

    def over(self, scales: np.ndarray) -> float:
        """RMSE over all frames and joints, each joint's error divided by its scale, shape (n,)."""
        return float(np.sqrt(np.average((self.squared / scales**2).mean(axis=1), weights=self.lengths)))

    @property
    def per_joint(self) -> dict[str, float]:
        """RMSE of each joint over all frames [rad; slides m]."""
        values = np.sqrt(np.average(self.squared, axis=0, weights=self.lengths))
        return dict(zip(self.joints, values.tolist(), strict=True))

    @property
    def per_episode(self) -> list[float]:
        """RMSE of each episode over its joints of the first kind."""
        return np.sqrt(self.squared[:, self.kinds[0][1]].mean(axis=1)).tolist()

    @property
    def mean_of_episodes(self) -> float:
        """Mean of the episodes' RMSE; episodes have equal weight, whatever their length."""
        return float(np.mean(self.per_episode))

    def to_json(self) -> dict[str, object]:
        """Return all figures for JSON, per episode also by joint."""
        rows = [dict(zip(self.joints, np.sqrt(row).tolist(), strict=True)) for row in self.squared]
        beside = {f"overall_{unit.kind}": value for unit, value in self.overall_by_kind[1:]}
        return {
            "overall": self.overall,
            **beside,
            "mean_of_episodes": self.mean_of_episodes,
            "per_joint": self.per_joint,
            "per_episode": self.per_episode,
            "per_episode_and_joint": rows,
        }


def format_error_table(rows: Mapping[str, Errors], title: str) -> str:
    """Return a table of RMSE in degrees, slides in millimetres: one row per predictor, one column per joint.

    The last columns are all joints (hinges and slides apart if an arm has both) and the mean of the episodes. A
    predictor that diverges in any episode is marked and has no mean error.
    """
    one = next(iter(rows.values()))
    scale = list_unit_factors(one.joints, one.slides)
    pooled = [unit.kind if len(one.kinds) > 1 else "all" for unit, _ in one.kinds]
    table = [["", *one.joints, *pooled, "mean of episodes"]]
    for name, errors in rows.items():
        if not np.isfinite(errors.overall):
            table.append([name, *[""] * (len(table[0]) - 2), "diverged"])
            continue
        overall = [unit.factor * value for unit, value in errors.overall_by_kind]
        mean = errors.unit.factor * errors.mean_of_episodes
        table.append([name, *(f"{value:.3f}" for value in (*scale * list(errors.per_joint.values()), *overall, mean))])
    heading = f"{title} [{format_table_unit(one.joints, one.slides)}]"
    return "\n".join([heading, *(f"  {line}" for line in align_columns(table, least=7))])
