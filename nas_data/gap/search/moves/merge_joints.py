"""Merge what joints have alike: one effect of the whole arm in the place of the same effect in several joints."""

from collections.abc import Sequence

import numpy as np

from nas_data.effects.base import Effect, make_effect
from nas_data.gap.search.hypothesis import Description, Hypothesis, key
from nas_data.gap.search.moves.add import extensions
from nas_data.gap.search.search import Search

MOST = 0.5  # share of the joints that must have an effect for it to be thought the arm's


def apply(search: Search, h: Hypothesis) -> Hypothesis:
    """Put one effect of the arm in the place of those of several joints, where that is worth more."""
    for name in dict.fromkeys(effect.name() for effect in h.effects if effect.whole_arm and effect.per_joint):
        alike = [effect for effect in h.effects if effect.name() == name]
        if len(alike) < 2:
            continue
        others = [effect for effect in h.effects if effect.name() != name]
        whole = typical(alike)
        one = fit_whole(search, h, [*others, whole])
        if one is None or one.score >= h.score:
            one = reconsider(search, h, alike, others, whole)
        if one is not None and one.score < h.score:
            search.rivals.setdefault(key(whole), []).extend(e for e in alike if e.joint)
            search.report(f"  {name} of {len(alike)} joints merged", one)
            return one
    return h


def fit_whole(search: Search, h: Hypothesis, effects: Sequence[Effect]) -> Hypothesis | None:
    """Fit a hypothesis with other effects, from where it is."""
    left = {effect.name() for effect in effects if effect.joint}
    description = Description(tuple(effects), h.description.freed, h.description.shared & left)
    return search.fitted(description, h.fit.factors, h.fit, steps=6, jacobian_refreshes=1)


def reconsider(
    search: Search, h: Hypothesis, alike: Sequence[Effect], others: Sequence[Effect], whole: Effect
) -> Hypothesis | None:
    """Merge where most joints are alike, and name anew what the others have: it stood in for the arm's effect, too."""
    joints = {effect.joint for effect in alike}
    if len(joints) < MOST * len(search.train.nominal.joints):
        return None
    kept = [effect for effect in others if effect.joint is None or effect.joint in joints]
    one = fit_whole(search, h, [*kept, whole])
    return None if one is None else min([one, *extensions(search, one, one.fit)], key=lambda found: found.score)


def typical(alike: Sequence[Effect]) -> Effect:
    """Return the arm's effect with the median of the parameters that several joints' have."""
    medians = {p.name: float(np.median([getattr(effect, p.name) for effect in alike])) for p in alike[0].parameters}
    return make_effect(alike[0].name(), None, medians)
