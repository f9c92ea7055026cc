"""Exchange effects that may only stand in for others: the first found is not always the right one."""

from nas_data.gap.search.hypothesis import GAIN, Hypothesis, place
from nas_data.gap.search.state import FAR_BEHIND, Search

UNSATISFIED = 1.25  # noise floors above which other effects are tried in the place of one that was found
EXCHANGED = 4  # of them


def exchanged(search: Search, h: Hypothesis) -> Hypothesis:
    """Try other effects in the place of each whose joint is still above the floor: the first found may stand in."""
    if (places := frozenset(map(place, h.effects))) in search.settled:
        return h
    search.settled.add(places)
    for number, effect in enumerate(h.effects):
        joints = search.train.nominal.joints
        if effect.joint is None or search.ratio(h)[joints.index(effect.joint)] <= UNSATISFIED:
            continue
        rest = search.without(h, number)
        if rest is None:
            continue
        found, reach = search.screened(rest.fit, h, {effect.joint})
        others = [c for c in found if c.effect.joint and c.place != place(effect)][:EXCHANGED]
        others = [c for c in others if c.misfit < reach + FAR_BEHIND]
        quick = [search.fitted((*rest.effects, c.effect), c.factors, rest.fit, steps=3) for c in others]
        ranked = sorted((other for other in quick if other), key=lambda other: other.loss)
        best = search.continued(ranked[0]) if ranked else None
        if best and best.loss < h.loss - GAIN:
            search.rivals.setdefault(place(best.effects[-1]), []).append(effect)
            search.report(f"  {effect.name()} exchanged", best)
            return exchanged(search, search.refined(best))
    return h
