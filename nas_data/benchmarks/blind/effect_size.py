"""How visible each hidden effect is: the plant played with and without it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from nas_data.benchmarks.blind.truth import Truth

Show = Callable[[Sequence[Truth]], np.ndarray]  # truths → states (len(truths), E, T + 1, 2n)


@dataclass(frozen=True)
class Marks:
    """What was seen of a truth.

    Attributes:
        values: Of each effect: RMS over all episodes of what it changes, as a multiple of the noise floor.
        joints: Joint on which that is: the effect's own, or the one most changed for effects of the whole arm.
        states: What the whole truth does, positions [rad] then velocities [rad/s], shape (E, T + 1, 2n).
    """

    values: tuple[float, ...]
    joints: tuple[str, ...]
    states: np.ndarray


def measure_marks(show: Show, truth: Truth, joints: Sequence[str], floor: float) -> Marks:
    """Play the whole truth, and it without each of its effects in turn; the floor is in radians."""
    played = show([truth, *(truth.without(index) for index in range(len(truth.hidden)))])
    positions = played[..., : len(joints)]
    changes = [np.sqrt(np.square(positions[0] - without).mean(axis=(0, 1))) / floor for without in positions[1:]]
    seen = [mark(change, joints, hidden.joint) for change, hidden in zip(changes, truth.hidden, strict=True)]
    return Marks(tuple(value for value, _ in seen), tuple(joint for _, joint in seen), played[0])


def mark(change: np.ndarray, joints: Sequence[str], joint: str | None) -> tuple[float, str]:
    """Return one effect's mark and the joint it was measured on, of what it changes in each joint."""
    row = int(np.argmax(change)) if joint is None else joints.index(joint)
    return float(change[row]), joints[row]


def out_of_sight(marks: Sequence[float], least: float, most: float) -> list[int]:
    """Return which effects leave less than the least mark, or more than the most; a plant that diverged shows none."""
    return [index for index, value in enumerate(marks) if not (least <= value <= most and value < np.inf)]
