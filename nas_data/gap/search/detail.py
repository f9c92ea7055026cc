"""Seek the details of an effect, such as where a payload sits, where the data tell them."""

from nas_data.gap.search.hypothesis import Hypothesis
from nas_data.gap.search.state import Search

WORTH = 3.0  # nats by which each detail must lower the loss


def detailed(search: Search, h: Hypothesis) -> Hypothesis:
    """Fit on with the details of all effects, and keep them where they lower the loss."""
    effects = tuple(effect.detailed() for effect in h.effects)
    details = sum(len(one.sought) - len(other.sought) for one, other in zip(effects, h.effects, strict=True))
    if not details:
        return h
    found = search.fitted(effects, h.fit.factors, h.fit, renewals=1)
    if found is None or found.loss > h.loss - WORTH * details:
        return h
    search.report("  in detail", found)
    return found
