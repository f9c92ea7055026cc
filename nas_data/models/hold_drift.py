"""Drift of open-loop predictions while the command of a joint is constant."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from nas_data.dataset.dataset import Dataset
from nas_data.joint_units import format_table_unit, group_by_kind, list_unit_factors
from nas_data.text_table import align_columns

SECONDS = 5.0  # [s] duration of a hold


@dataclass(frozen=True)
class HoldDrift:
    """Mean absolute change of the position error over holds of `SECONDS`, of which every start frame counts.

    A hold is a time in which the command of the joint is constant. The arm may still move when it begins: a prediction
    that moves with it does not drift.

    Attributes:
        joints: Names of the n joints.
        holds: Number of start frames of each joint, shape (n,).
        drift: Drift of each joint [rad; slides m] by predictor, shape (n,); NaN without holds or after divergence.
        slides: Names of the joints that are slides.
    """

    joints: tuple[str, ...]
    holds: np.ndarray
    drift: Mapping[str, np.ndarray]
    slides: frozenset[str] = frozenset()

    @classmethod
    def of(cls, dataset: Dataset, rollouts: Mapping[str, Sequence[np.ndarray]]) -> "HoldDrift":
        """Measure the drift of open-loop rollouts.

        Args:
            dataset: Episodes with commanded positions.
            rollouts: Positions or states of each episode, shape (T, ≥n), by predictor.
        """
        n, frames = len(dataset.joints), round(SECONDS * dataset.fps)
        rows = list(dataset.episodes())
        held = [find_holds(dataset.commands[part], frames) for part in rows]
        holds = np.sum([mask.sum(axis=0) for mask in held], axis=0)
        drift: dict[str, np.ndarray] = {}
        for name, rolled in rollouts.items():
            total = np.zeros(n)
            for part, states, mask in zip(rows, rolled, held, strict=True):
                error = states[:, :n] - dataset.next_states[part, :n]
                total += np.where(mask, np.abs(error[frames:] - error[: len(mask)]), 0.0).sum(axis=0)
            drift[name] = np.divide(total, holds, out=np.full(n, np.nan), where=holds > 0)
        return cls(dataset.joints, holds, drift, frozenset(dataset.slides))

    def average(self, name: str) -> float:
        """Return the mean drift of a predictor over all holds of the joints of the first kind [rad; m]."""
        places = group_by_kind(self.joints, self.slides)[0][1]
        places = places[self.holds[places] > 0]
        return float(np.average(self.drift[name][places], weights=self.holds[places])) if len(places) else float("nan")

    def text(self) -> str:
        """Return a table of the drift of each predictor."""
        factors = list_unit_factors(self.joints, self.slides)
        unit = group_by_kind(self.joints, self.slides)[0][0]
        cells = [["", *self.joints, "all"]]
        for name, values in self.drift.items():
            shown = (*factors * values, unit.factor * self.average(name))
            cells.append([name, *(f"{value:.3f}" if np.isfinite(value) else "–" for value in shown)])
        title = f"Holding: mean change of the error in {SECONDS:g} s of constant command"
        heading = f"{title} [{format_table_unit(self.joints, self.slides)}]"
        return "\n".join([heading, *(f"  {line}" for line in align_columns(cells, least=7))])

    def to_json(self) -> dict[str, object]:
        """Return the drift [rad; slides m] by predictor and joint; None without holds or after divergence."""
        return {
            name: {
                joint: float(value) if np.isfinite(value) else None
                for joint, value in zip((*self.joints, "all"), (*values, self.average(name)), strict=True)
            }
            for name, values in self.drift.items()
        }


def find_holds(commands: np.ndarray, frames: int) -> np.ndarray:
    """Return a mask of the frames from which a joint's command stays constant for some frames, shape (T − frames, n).

    Args:
        commands: Shape (T, n).
        frames: Duration of a hold in frames.
    """
    if len(commands) <= frames:
        return np.zeros((0, commands.shape[1]), bool)
    changes = np.concatenate([np.zeros((1, commands.shape[1]), int), np.cumsum(np.diff(commands, axis=0) != 0, axis=0)])
    return changes[frames:] == changes[:-frames]
