"""Errors that a model has in a baseline with the same motion, too."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from nas_data.gap.episode_batch import EpisodeBatch
from nas_data.gap.search.objective import FitTask
from nas_data.gap.usual_error import UsualError
from nas_data.gap.windows import cut_window, join_episodes, pad_episodes

SAME_COMMANDS = 0.3  # largest difference of commands, as a share of their standard deviations, of the same motion
ALIKE = 0.3  # difference of positions, as a share of the motion, with which errors of the model are hardly alike
MOSTLY = 0.5  # correlation above which errors count as subtracted
HELD = 0.05  # share of the largest motion below which a joint's commands count as held
COPIED = 1e-6  # [rad; m] standard deviation of the difference between a recording and its copy
LEAST = 1e-24  # [rad²; m²] so that joints without motion divide by no zero
SAME_LENGTH = 0.9  # least share of an episode's rows that the baseline must have


@dataclass(frozen=True)
class RepeatedMotion:
    """What a model leaves unexplained in a recording of the same motion.

    Attributes:
        errors: Measured minus predicted positions there [rad; m], shape (E, T, n); 0 without such a recording.
        correlation: How far the model's errors in both recordings are alike, 0 to 1, shape (E, n).
        rows: Which rows the baseline has, shape (E, T); all without such a recording.
    """

    errors: np.ndarray
    correlation: np.ndarray
    rows: np.ndarray

    @classmethod
    def find(cls, task: FitTask, before: FitTask) -> "RepeatedMotion":
        """Find the same motions in a baseline by their commands, and simulate them.

        The correlation of the errors is assumed to be exp(−(s / 0.3)²); see `compare_motions` for s. It is 0 for a
        copy of the baseline, whose noise would be subtracted, too.

        Args:
            task: Episodes, or windows of episodes.
            before: Whole episodes of the baseline, with the model that describes them.
        """
        evidence = task.evidence
        matches = np.array([find_same_commands(evidence, number, before.evidence) for number in range(len(evidence))])
        repeated = cut_matches(evidence, before.evidence, matches)
        common = (evidence.mask & repeated.mask)[..., None]
        differences = np.where(common, evidence.measured - repeated.measured, 0.0)
        is_repeated = ((matches >= 0) & ~find_copies(differences, common))[:, None]
        simulated = replace(before, evidence=repeated).infer_initial_loads((), {}).settle()
        errors = -repeated.errors(simulated.roll_out(simulated.evidence, (), {}))
        errors = np.where(common & is_repeated[..., None], errors, 0.0)
        sizes = repeated.motions**2 + average(errors**2, common)
        share = compare_motions(average(differences**2, common), sizes)
        rows = repeated.mask | ~is_repeated
        return cls(errors, np.where(is_repeated, np.exp(-((share / ALIKE) ** 2)), 0.0), rows)

    @property
    def is_alike(self) -> np.ndarray:
        """Whether most of the error of a joint is subtracted, shape (E,)."""
        return np.asarray(self.correlation.max(axis=1) > MOSTLY)

    def subtract(self, task: FitTask, usual: UsualError) -> FitTask:
        """Return the task with these errors subtracted from the measured positions, as far as they are alike.

        With a correlation r, the share r is subtracted. √(1 − r²) of the usual error, and the noise of the other
        recording, remain to be expected. Rows that the baseline lacks are left out.
        """
        evidence, agreed = task.evidence, self.correlation
        squares = (1 - agreed**2) * usual.predict(evidence.motions) ** 2 + (agreed * task.floor) ** 2
        measured = evidence.measured - agreed[:, None] * self.errors
        corrected = replace(evidence, measured=measured, mask=evidence.mask & self.rows)
        return replace(task, evidence=corrected, usual_error=np.sqrt(squares))


def average(values: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Return the mean over some rows of each episode, shape (E, n); 0 without rows."""
    return np.asarray(np.where(rows, values, 0.0).sum(axis=1) / np.maximum(rows.sum(axis=1), 1))


def find_copies(differences: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Return which episodes have the readings of another, possibly with another zero, shape (E,)."""
    spread = average((differences - average(differences, rows)[:, None]) ** 2, rows)
    return np.asarray((spread <= COPIED**2).all(axis=1))


def compare_motions(differences: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """Return the difference of two motions as a share of the motion: that of the joint, or of all joints if larger.

    Args:
        differences: Mean squared differences of positions [rad²; m²], shape (E, n).
        sizes: Mean squares of motions and errors [rad²; m²], shape (E, n).
    """
    typical = np.maximum(sizes.mean(axis=0), LEAST)
    together = (differences / typical).sum(axis=1) / np.maximum((sizes / typical).sum(axis=1), LEAST)
    return np.sqrt(np.maximum(differences / np.maximum(sizes, LEAST), together[:, None]))


def find_same_commands(evidence: EpisodeBatch, number: int, before: EpisodeBatch) -> int:
    """Return the index of the baseline's episode with the same commands as an episode or window; -1 for none.

    The commands of both have the same rate and row numbers, and the torque is on in the same rows.
    """
    if not np.isclose(evidence.period, before.period):
        return -1
    rows, first = int(evidence.mask[number].sum()), int(evidence.first_rows[number])
    moved = before.commands[before.mask].std(axis=0)
    scales = np.maximum(moved, max(HELD * float(moved.max()), LEAST))  # a held joint's jitter is no other motion

    def compare() -> Iterator[tuple[float, int]]:
        for index, length in enumerate(before.mask.sum(axis=1)):
            common = min(rows, int(length) - first)
            off = int(before.torque_off_from[index]) - first
            is_same_off = min(off, common) == min(int(evidence.torque_off_from[number]), common)
            if common >= SAME_LENGTH * rows and is_same_off:
                other = before.commands[index, first : first + common]
                yield float(np.mean(((evidence.commands[number, :common] - other) / scales) ** 2)), index

    difference, index = min(compare(), default=(np.inf, -1))
    return index if difference < SAME_COMMANDS**2 else -1


def cut_matches(evidence: EpisodeBatch, before: EpisodeBatch, matches: np.ndarray) -> EpisodeBatch:
    """Return the same rows of the baseline's matching episodes; those of any episode where none matches."""
    steps = evidence.commands.shape[1]
    padded = pad_episodes(before, int(evidence.first_rows.max()) + steps)
    pairs = zip(matches, evidence.first_rows, strict=True)
    return join_episodes(
        [cut_window(padded, max(int(match), 0), int(first) if match >= 0 else 0, steps) for match, first in pairs]
    )
