"""Let the servos of one make share a value: the same parameters for an effect in all joints that have it."""

from dataclasses import replace

import numpy as np

from nas_data.effects.base import Effect, make_effect
from nas_data.gap.search.hypothesis import Hypothesis
from nas_data.gap.search.search import Search

FEWEST = 3  # joints with an effect, or all of a smaller robot's, from which it may be a matter of the make


def apply(search: Search, h: Hypothesis) -> Hypothesis:
    """Share the values of an effect, or give each joint its own again, where that is worth more."""
    fewest = min(FEWEST, max(2, len(search.excited)))
    for name in dict.fromkeys(effect.name() for effect in h.effects if effect.joint):
        if sum(effect.name() == name and effect.joint is not None for effect in h.effects) < fewest:
            continue
        changed = h.description.shared ^ {name}
        effects = h.effects if name in h.description.shared else with_mean(h.effects, name)
        description = replace(h.description, effects=tuple(effects), shared=changed)
        found = search.fitted(description, h.fit.factors, h.fit, steps=6, jacobian_refreshes=1)
        if found is not None and found.is_sound and found.score < h.score:
            search.report(f"  {name} {'shared' if name in changed else 'of each joint'}", found)
            h = found
    return h


def with_mean(effects: tuple[Effect, ...], name: str) -> list[Effect]:
    """Return effects of which those of one name have the geometric mean of their parameters; the mean where signed."""
    alike = [effect for effect in effects if effect.name() == name and effect.joint is not None]
    values = {}
    for parameter in alike[0].parameters:
        own = np.array([getattr(effect, parameter.name) for effect in alike], float)
        values[parameter.name] = float(np.exp(np.log(own).mean()) if (own > 0).all() else own.mean())
    return [make_effect(name, e.joint, values) if e.name() == name and e.joint is not None else e for e in effects]
