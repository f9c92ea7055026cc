"""Confidence in a name: how close its rivals are, how often it is chosen, and how much remains in its joints."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nas_data.effects.base import Effect
from nas_data.gap.residual_correlates import compute_explained_variance, encode_position_bins
from nas_data.gap.rivals import Rival
from nas_data.gap.search.hypothesis import Hypothesis
from nas_data.gap.search.search import Search

REDRAWS = 400  # random draws of the episodes, with replacement
UNSTABLE = 0.5  # factor on the confidence of a name in a joint on whose parameters two halves disagree
CONSTANT_SHARE = 0.1  # share of a constant error by which an error that depends on the position contradicts it
UNSURE_FLOORS = 2.0  # noise floors of a name's own joints above which its confidence may fall


@dataclass(frozen=True, kw_only=True)
class Support:
    """What a name rests on.

    Attributes:
        closest_rival: Closeness of the nearest rival: 1 if it predicts as well in every joint, 0 if much worse.
        chosen: Share of random draws of the episodes in which the score is lower with the name than without it.
        rest: Largest held-out error of its joints with it [noise floors].
        left: Held-out error of its joints with it over that without it, everything else fitted again.
        position_dependence: For an effect that is the same in every posture, how far the remaining error contradicts
            that, 0 to 1; see `compute_position_dependence`. None for other effects.
        stable: Whether two halves of the recording agree on the effects' parameters in its joint; None if unknown.
    """

    closest_rival: float
    chosen: float
    rest: float
    left: float
    position_dependence: float | None = None
    stable: bool | None = None

    @property
    def confidence(self) -> float:
        """Probability that the name is right; docs/concepts/confidence.md explains the formula."""
        explained = max(math.sqrt(UNSURE_FLOORS / max(self.rest, UNSURE_FLOORS)), 1 - self.left)
        rival = max(self.closest_rival, self.position_dependence or 0.0)
        agreed = UNSTABLE if self.stable is False else 1.0
        return round((1 - 0.5 * rival) * self.chosen * explained * agreed, 3)


def measure_support(
    search: Search,
    kept: Hypothesis,
    effect: Effect,
    without: Hypothesis,
    rivals: Sequence[Rival],
    joints: Sequence[int],
    stable: bool | None,
) -> Support:
    """Return what a name of a hypothesis rests on.

    Args:
        search: Episodes, and the objective of all hypotheses.
        kept: Hypothesis with the name.
        effect: The named effect.
        without: Hypothesis without it, everything else fitted again.
        rivals: Its rivals, with its absence.
        joints: Indices of the joints that judge the name.
        stable: Whether two halves of the recording agree in its joint; None if unknown.
    """
    own = list(joints)
    return Support(
        closest_rival=max(rival.closeness for rival in rivals if not rival.is_equivalent),
        chosen=compute_chosen_share(search, kept, without),
        rest=float(search.floor_ratios(kept)[own].max()),
        left=float(np.sqrt(kept.heldout[:, own].mean() / without.heldout[:, own].mean())),
        position_dependence=compute_position_dependence(search, kept, effect),
        stable=stable,
    )


def compute_position_dependence(search: Search, kept: Hypothesis, effect: Effect) -> float | None:
    """Return how far the remaining error contradicts an effect that is the same in every posture, 0 to 1.

    A rival of such an effect is an error that depends on the position, as that of an eccentric gear or of a curved
    calibration. Near one posture both look alike. The result is v / (0.1 b)², at most 1: b is the effect's constant
    error, and v the variance of the remaining error between positions, adjusted for the number of bins.

    Returns:
        The ratio; None for other effects.
    """
    if (constant := effect.constant_error) is None or effect.joint is None:
        return None
    evidence = search.task.evidence
    joint, mask = evidence.joints.index(effect.joint), evidence.mask
    errors = evidence.errors(kept.fit.predicted)[..., joint][mask]
    share = compute_explained_variance(errors, encode_position_bins(evidence.measured[..., joint][mask]))
    return float(np.clip(share * errors.var() / (CONSTANT_SHARE * constant) ** 2, 0.0, 1.0)) if constant else 0.0


def compute_chosen_share(search: Search, kept: Hypothesis, without: Hypothesis) -> float:
    """Return the share of random draws of the episodes (bootstrap) in which a hypothesis has the lower score.

    Both keep their parameters. Fitted and held-out episodes are drawn together; long ones are windows of 5 s. Priors
    and prices do not depend on the draw.
    """
    rescored = search.rescore(without)
    gains = np.concatenate(
        [
            search.task.misfits(rescored.fit.predicted) - search.task.misfits(kept.fit.predicted),
            search.held.compute_misfits(rescored.heldout) - search.held.compute_misfits(kept.heldout),
        ]
    ).sum(1)
    constant = rescored.score.over(kept.score) - float(gains.sum())
    counts = np.random.default_rng(0).multinomial(len(gains), np.full(len(gains), 1 / len(gains)), REDRAWS)
    return float((counts @ gains + constant > 0).mean())
