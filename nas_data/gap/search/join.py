"""Join what the joints have alike: one effect of the whole arm in the place of the same effect in several joints."""

from collections.abc import Sequence

import numpy as np

from nas_data.effects.base import Effect, make_effect
from nas_data.gap.search.grow import extensions
from nas_data.gap.search.hypothesis import Hypothesis, place, worth
from nas_data.gap.search.state import Search

MOST = 0.5  # share of the joints that must have an effect for it to be thought the arm's


def joined(search: Search, h: Hypothesis) -> Hypothesis:
    """Put one effect of the arm in the place of those of several joints, where it explains them as well."""
    for name in dict.fromkeys(effect.name() for effect in h.effects if effect.whole_arm and effect.per_joint):
        alike = [effect for effect in h.effects if effect.name() == name]
        if len(alike) < 2:
            continue
        others = tuple(effect for effect in h.effects if effect.name() != name)
        whole = typical(alike)
        one = search.fitted((*others, whole), h.fit.factors, h.fit, steps=6, renewals=1)
        if one is None or worth(one) >= worth(h):
            one = reconsidered(search, h, alike, others, whole)
        if one is not None and worth(one) < worth(h):
            search.rivals.setdefault(place(whole), []).extend(e for e in alike if e.joint)
            search.report(f"  {name} of {len(alike)} joints joined", one)
            return one
    return h


def reconsidered(
    search: Search, h: Hypothesis, alike: Sequence[Effect], others: Sequence[Effect], whole: Effect
) -> Hypothesis | None:
    """Join where most joints are alike, and name anew what the others have: it stood in for the arm's effect, too."""
    joints = {effect.joint for effect in alike}
    if len(joints) < MOST * len(search.train.nominal.joints):
        return None
    kept = tuple(effect for effect in others if effect.joint is None or effect.joint in joints)
    one = search.fitted((*kept, whole), h.fit.factors, h.fit, steps=6, renewals=1)
    return None if one is None else min([one, *extensions(search, one, one.fit)], key=worth)


def typical(alike: Sequence[Effect]) -> Effect:
    """Return the arm's effect with the median of the parameters that several joints' have."""
    medians = {p.name: float(np.median([getattr(effect, p.name) for effect in alike])) for p in alike[0].parameters}
    return make_effect(alike[0].name(), None, medians)
