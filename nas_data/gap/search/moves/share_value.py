"""Share an effect's parameters between joints, because servos of one make are alike."""

from dataclasses import replace

import numpy as np

from nas_data.effects.base import Effect, make_effect
from nas_data.gap.search.constants import SIMPLE_SIZE
from nas_data.gap.search.hypothesis import Hypothesis
from nas_data.gap.search.search import Search


def apply(search: Search, h: Hypothesis) -> Hypothesis:
    """Share the parameters of an effect, or separate them again, if the score falls."""
    fewest = min(SIMPLE_SIZE, max(2, len(search.excited)))
    for name in dict.fromkeys(effect.name() for effect in h.effects if effect.local_joint):
        if sum(effect.name() == name and effect.local_joint is not None for effect in h.effects) < fewest:
            continue
        changed = h.description.shared ^ {name}
        effects = h.effects if name in h.description.shared else average_parameters(h.effects, name)
        description = replace(h.description, effects=tuple(effects), shared=changed)
        found = search.fit_description(description, h.fit.factors, h.fit, steps=6, jacobian_refreshes=1)
        if found is not None and found.is_finite and found.score < h.score:
            search.report(f"  {name} {'shared' if name in changed else 'of each joint'}", found)
            h = found
    return h


def average_parameters(effects: tuple[Effect, ...], name: str) -> list[Effect]:
    """Replace parameters of one kind of effect by their geometric mean, or their mean if signs differ."""
    alike = [effect for effect in effects if effect.name() == name and effect.local_joint is not None]
    values = {}
    for parameter in alike[0].parameters:
        own = np.array([getattr(effect, parameter.name) for effect in alike], float)
        values[parameter.name] = float(np.exp(np.log(own).mean()) if (own > 0).all() else own.mean())
    return [make_effect(name, e.joint, values) if e in alike else e for e in effects]
