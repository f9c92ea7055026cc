"""How visible each hidden effect is: the plant played with and without it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nas_data.blind.arms import Arm
from nas_data.blind.case import FLOOR, RATE
from nas_data.blind.plants.base import Play
from nas_data.blind.truth import Truth


@dataclass(frozen=True)
class Marks:
    """What was seen of a truth.

    Attributes:
        values: Of each effect: RMS over all episodes of what it changes, as a multiple of the noise floor.
        joints: Joint on which that is: the effect's own, or the one most changed for effects of the whole arm.
        positions: What the whole truth does [rad], shape (E, T + 1, n).
    """

    values: tuple[float, ...]
    joints: tuple[str, ...]
    positions: np.ndarray


def measure_marks(play: Play, arm: Arm, truth: Truth, commands: np.ndarray, poses: np.ndarray) -> Marks:
    """Play the whole truth, and it without each of its effects in turn."""
    truths = [truth, *(truth.without(index) for index in range(len(truth.hidden)))]
    played = play(arm, truths, commands, poses, 1 / RATE)
    pairs = zip(played[1:], truth.hidden, strict=True)
    seen = [mark(played[0], without, arm, hidden.joint) for without, hidden in pairs]
    return Marks(tuple(value for value, _ in seen), tuple(joint for _, joint in seen), played[0])


def mark(whole: np.ndarray, without: np.ndarray, arm: Arm, joint: str | None) -> tuple[float, str]:
    """Return one effect's mark and the joint it was measured on; positions have shape (E, T + 1, n)."""
    change = np.sqrt(np.square(whole - without).mean(axis=(0, 1))) / FLOOR
    row = int(np.argmax(change)) if joint is None else arm.joints.index(joint)
    return float(change[row]), arm.joints[row]


def too_faint(marks: Sequence[float], least: float) -> list[int]:
    """Return which effects leave less than the least mark; a plant that diverged shows none at all."""
    return [index for index, value in enumerate(marks) if not least <= value < np.inf]
