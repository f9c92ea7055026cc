"""Verdict of a gap report."""

from collections.abc import Sequence

import numpy as np

from nas_data.gap.search.constants import EXPLAINED

NO_GAP = 1.25  # noise floors up to which the given model has no gap
EXPLAINED_VERDICTS = ("explained", "retuned")  # verdicts of models at the noise floor


def decide_verdict(
    before: np.ndarray, after: np.ndarray, named: int, added: int = 0, changed: int = 1, large: int = 0
) -> str:
    """Return the verdict.

    Args:
        before: Held-out error of the given model over the floor, shape (n,).
        after: The same with effects and retuned base parameters, shape (n,).
        named: Number of named effects.
        added: Number of effects in the model, which a plain fit has without naming them.
        changed: Number of changed base parameters.
        large: How many of them changed by more than 25 %, which no effect of the catalogue can name.
    """
    if named:
        return "explained" if after.max() <= EXPLAINED else "partly_explained"
    if before.max() <= NO_GAP:
        return "none"
    if after.max() > EXPLAINED or added or large:
        return "unexplained"
    return "retuned" if changed else "none"


def find_above(after: np.ndarray, limit: float) -> Sequence[int]:
    """Return the indices of joints above a limit, largest first."""
    return [int(joint) for joint in np.argsort(-after) if after[joint] > limit]
