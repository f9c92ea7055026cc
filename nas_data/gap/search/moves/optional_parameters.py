"""Free the optional parameters of an effect, such as where a payload sits, where the data tell them."""

from nas_data.gap.search.hypothesis import Hypothesis
from nas_data.gap.search.search import Search


def apply(search: Search, h: Hypothesis) -> Hypothesis:
    """Fit on with the optional parameters of all effects, and keep them where they are worth their price."""
    effects = tuple(effect.with_optional_parameters() for effect in h.effects)
    if effects == h.effects:
        return h
    found = search.fitted(h.description.with_effects(effects), h.fit.factors, h.fit, jacobian_refreshes=1)
    if found is None or found.score >= h.score:
        return h
    search.report("  in detail", found)
    return found
