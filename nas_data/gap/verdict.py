"""The verdict: nothing, retuned, explained, partly explained or unexplained."""

from collections.abc import Sequence

import numpy as np

from nas_data.gap.name import ADEQUATE

NOTHING = 1.25  # noise floors up to which a model as handed over has no gap
EXPLAINED = ("explained", "retuned")  # verdicts that say that what was named or retuned leaves the noise floor


def verdict(before: np.ndarray, after: np.ndarray, effects: int) -> str:
    """Return the verdict.

    Args:
        before: Held-out error over the floor of the model as handed over, shape (n,).
        after: The same for the model with effects and retuned base, shape (n,).
        effects: How many effects are named.
    """
    if effects:
        return "explained" if after.max() <= ADEQUATE else "partly_explained"
    if before.max() <= NOTHING:
        return "none"
    return "retuned" if after.max() <= ADEQUATE else "unexplained"


def above(after: np.ndarray, limit: float) -> Sequence[int]:
    """Return the joints that stay above a limit, the worst first."""
    return [int(joint) for joint in np.argsort(-after) if after[joint] > limit]
