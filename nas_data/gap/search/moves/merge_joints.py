"""Replace the same effect in several joints by one effect of the whole arm."""

from collections.abc import Sequence

import numpy as np

from nas_data.effects.base import Effect, make_effect
from nas_data.gap.search.constants import GAIN_SHARE
from nas_data.gap.search.hypothesis import Description, Hypothesis, effect_key
from nas_data.gap.search.moves.add import extend
from nas_data.gap.search.search import Search


def apply(search: Search, h: Hypothesis) -> Hypothesis:
    """Replace effects of several joints by one of the whole arm, if the score falls."""
    for name in dict.fromkeys(effect.name() for effect in h.effects if effect.whole_arm and effect.per_joint):
        alike = [effect for effect in h.effects if effect.name() == name]
        if len(alike) < 2:
            continue
        others = [effect for effect in h.effects if effect.name() != name]
        whole = take_medians(alike)
        one = fit_whole(search, h, [*others, whole])
        if one is None or one.score >= h.score:
            one = merge_most(search, h, alike, others, whole)
        if one is not None and one.score < h.score:
            search.rivals.setdefault(effect_key(whole), []).extend(e for e in alike if e.joint)
            search.report(f"  {name} of {len(alike)} joints merged", one)
            return one
    return h


def fit_whole(search: Search, h: Hypothesis, effects: Sequence[Effect]) -> Hypothesis | None:
    """Fit a hypothesis with other effects, from its present values."""
    left = {effect.name() for effect in effects if effect.joint}
    description = Description(tuple(effects), h.description.freed, h.description.shared & left)
    return search.fit_description(description, h.fit.factors, h.fit, steps=6, jacobian_refreshes=1)


def merge_most(
    search: Search, h: Hypothesis, alike: Sequence[Effect], others: Sequence[Effect], whole: Effect
) -> Hypothesis | None:
    """Merge and drop the effects of all other joints, which may have compensated for the missing effect."""
    joints = {effect.joint for effect in alike}
    if len(joints) < GAIN_SHARE * len(search.train.nominal.joints):
        return None
    kept = [effect for effect in others if effect.joint is None or effect.joint in joints]
    one = fit_whole(search, h, [*kept, whole])
    return None if one is None else min([one, *extend(search, one, one.fit)], key=lambda found: found.score)


def take_medians(alike: Sequence[Effect]) -> Effect:
    """Return the whole arm's effect with the median parameters of several joints' effects."""
    medians = {p.name: float(np.median([getattr(effect, p.name) for effect in alike])) for p in alike[0].parameters}
    return make_effect(alike[0].name(), None, medians)
