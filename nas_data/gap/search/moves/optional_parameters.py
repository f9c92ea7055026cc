"""Free optional parameters of effects, such as the position of a payload."""

from nas_data.gap.search.hypothesis import Hypothesis
from nas_data.gap.search.search import Search


def apply(search: Search, h: Hypothesis) -> Hypothesis:
    """Fit the optional parameters of all effects, and keep them if they are worth their price."""
    effects = tuple(
        effect.with_optional_parameters(search.find_scales(effect.joint) if effect.joint else None)
        for effect in h.effects
    )
    if effects == h.effects:
        return h
    found = search.fit_description(h.description.with_effects(effects), h.fit.factors, h.fit, jacobian_refreshes=1)
    if found is None or found.score >= h.score:
        return h
    search.report("  with optional parameters", found)
    return found
