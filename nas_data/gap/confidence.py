"""Confidence in a name: how close its rivals are, how often it is chosen, and how much its joints leave unexplained."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nas_data.gap.search.hypothesis import Hypothesis
from nas_data.gap.search.search import Search

SHARPNESS = 4.0  # exponent of a rival's error ratio in its closeness
REDRAWS = 400  # random draws of the episodes, with replacement
EXPLAINED_FLOORS = 1.5  # noise floors up to which a joint is explained
UNSURE_FLOORS = 2.0  # noise floors of a name's own joints above which its confidence falls in any case


@dataclass(frozen=True, kw_only=True)
class Support:
    """What a name rests on.

    Attributes:
        closest_rival: Closeness of the nearest rival: 1 if it predicts as well in every joint, 0 if much worse.
        chosen: Share of random draws of the episodes in which the score is lower with the name than without it.
        unexplained: RMS error of its joints above the noise, with the name over without it; more if much remains.
    """

    closest_rival: float
    chosen: float
    unexplained: float

    @property
    def confidence(self) -> float:
        """Probability that the name is right; docs/concepts/confidence.md explains the formula."""
        return round((1 - 0.5 * self.closest_rival) * self.chosen * (1 - self.unexplained), 3)


def measure_support(
    search: Search, kept: Hypothesis, without: Hypothesis, rivals: Sequence[Hypothesis], joints: Sequence[int]
) -> Support:
    """Return what a name of a hypothesis rests on.

    Args:
        search: Episodes, and the objective of all hypotheses.
        kept: Hypothesis with the name.
        without: Hypothesis without it, everything else fitted again.
        rivals: Hypotheses with another effect in its place.
        joints: Indices of the joints that judge the name.
    """
    return Support(
        closest_rival=max(compute_closeness(search, kept, other) for other in [*rivals, without]),
        chosen=compute_chosen_share(search, kept, without),
        unexplained=compute_unexplained_share(search, kept, without, joints),
    )


def compute_closeness(search: Search, kept: Hypothesis, rival: Hypothesis) -> float:
    """Return the closeness of a rival's prediction: 1 if as good in every joint, 0 if much worse."""
    lead = float(search.log_error_ratios(rival, kept).mean(0).min())
    return min(1.0, math.exp(SHARPNESS * lead))


def compute_chosen_share(search: Search, kept: Hypothesis, without: Hypothesis) -> float:
    """Return the share of random draws of the episodes (bootstrap) in which a hypothesis has the lower score.

    Both keep their parameters. Fitted and held-out episodes are drawn together; long ones are windows of 5 s.
    """
    rescored = search.rescore(without)
    gains = np.concatenate(
        [
            search.task.misfits(rescored.fit.predicted) - search.task.misfits(kept.fit.predicted),
            misfits_of(search, rescored) - misfits_of(search, kept),
        ]
    ).sum(1)
    price = kept.description.price - rescored.description.price
    counts = np.random.default_rng(0).multinomial(len(gains), np.full(len(gains), 1 / len(gains)), REDRAWS)
    return float((counts @ gains > price).mean())


def misfits_of(search: Search, h: Hypothesis) -> np.ndarray:
    """Return the misfit of each held-out episode and joint [nats], shape (E, n)."""
    return np.asarray(0.5 * search.held.observations * np.log(search.held.tolerance + h.heldout))


def compute_unexplained_share(search: Search, kept: Hypothesis, without: Hypothesis, joints: Sequence[int]) -> float:
    """Return which share of the RMS error without a name, above the noise, also remains with it.

    A remaining error of up to `EXPLAINED_FLOORS` counts as none. If it exceeds `UNSURE_FLOORS`, the result is at least
    1 − √(`UNSURE_FLOORS` / largest rest): several effects of a joint may then trade off against each other.
    """
    after, before = (np.square(search.floor_ratios(h)[list(joints)]) for h in (kept, without))
    left = np.maximum(after - EXPLAINED_FLOORS**2, 0).sum()
    share = np.sqrt(min(1.0, left / max(np.maximum(before - 1, 0).sum(), 1e-9))) if left else 0.0
    return float(max(share, 1 - np.sqrt(UNSURE_FLOORS / max(np.sqrt(after.max()), UNSURE_FLOORS))))
