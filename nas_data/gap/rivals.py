"""Rivals of a name: hypotheses with another effect in its place, or without it."""

import math
from dataclasses import dataclass

from nas_data.effects.base import Effect
from nas_data.gap.search.hypothesis import Hypothesis, find_joints_beyond_prior
from nas_data.gap.search.search import Search

SHARPNESS = 4.0  # exponent of a rival's error ratio in its closeness
EQUAL_CLOSENESS = 0.8  # closeness above which a rival is listed as equal; 1 for equal predictions


@dataclass(frozen=True)
class Rival:
    """A fitted rival of a name.

    Attributes:
        hypothesis: Hypothesis with it; everything else is fitted again.
        effect: Effect in the place of the name; None for its absence.
        closeness: 1 if it predicts as well as the name in every joint, 0 if much worse.
        error: Held-out error of the joints that judge the name [rad; slides m].
        is_equivalent: Whether no data could distinguish it from the name. Such a rival does not reduce the confidence.
    """

    hypothesis: Hypothesis
    effect: Effect | None
    closeness: float
    error: float
    is_equivalent: bool = False

    @property
    def is_equal(self) -> bool:
        """Whether this recording cannot decide between it and the name."""
        return self.closeness >= EQUAL_CLOSENESS


def compute_closeness(search: Search, kept: Hypothesis, rival: Hypothesis) -> float:
    """Return the closeness of a rival: 1 if it predicts as well in every joint, 0 if much worse.

    It is 0 for a rival whose base parameters are beyond their prior in joints where those of `kept` are not.
    """
    if find_joints_beyond_prior(rival) - find_joints_beyond_prior(kept):
        return 0.0
    lead = float(search.log_error_ratios(rival, kept).mean(0).min())
    return min(1.0, math.exp(SHARPNESS * lead))
