"""Verdict of a gap report."""

from collections.abc import Sequence

import numpy as np

from nas_data.gap.search.constants import EXPLAINED

NO_GAP = 1.25  # noise floors up to which the given model has no gap
EXPLAINED_VERDICTS = ("explained", "retuned")  # verdicts of models at the noise floor


def decide_verdict(before: np.ndarray, after: np.ndarray, named: int, unnamed: int = 0, changed: int = 1) -> str:
    """Return the verdict.

    Args:
        before: Held-out error of the given model over the floor, shape (n,).
        after: The same with effects and retuned base parameters, shape (n,).
        named: Number of named effects.
        unnamed: Number of causes in the model without a name: effects that a plain fit adds, and base parameters that
            changed by more than 25 %.
        changed: Number of changed base parameters.
    """
    if named:
        return "explained" if after.max() <= EXPLAINED else "partly_explained"
    if before.max() <= NO_GAP:
        return "none"
    if after.max() > EXPLAINED or unnamed:
        return "unexplained"
    return "retuned" if changed else "none"


def find_above(after: np.ndarray, limit: float) -> Sequence[int]:
    """Return the indices of joints above a limit, largest first."""
    return [int(joint) for joint in np.argsort(-after) if after[joint] > limit]
