"""Exchange effects that may only stand in for others: the first found is not always the right one."""

from functools import partial

from nas_data.gap.search.hypothesis import Hypothesis, place, relief, strained
from nas_data.gap.search.screen import Candidate
from nas_data.gap.search.state import FAR_BEHIND, Search
from nas_data.gap.side_by_side import side_by_side

UNSATISFIED = 1.25  # noise floors above which other effects are tried in the place of one that was found
DOUBTED = 3  # effects in whose place others are tried
BETTER = 4.0  # nats by which another effect must lower the loss
EXCHANGED = 4  # effects that are tried there


def exchanged(search: Search, h: Hypothesis) -> Hypothesis:
    """Try other effects in the place of each whose joint is above the floor or strained: the first may stand in."""
    if (places := frozenset(map(place, h.effects))) in search.settled:
        return h
    search.settled.add(places)
    for number in doubtful(search, h):
        effect, rest = h.effects[number], search.without(h, number)
        if rest is None or effect.joint is None:
            continue
        found, reach = search.screened(rest.fit, h, {effect.joint})
        found = [c for c in found if c.effect.joint and c.place != place(effect)]
        own = [c for c in found if relief(h, c.effect)]
        others = [c for c in found[:EXCHANGED] if c.misfit < reach + FAR_BEHIND and c not in own] + own
        quick = side_by_side(partial(tried, search, rest), others)
        ranked = sorted((o for o in quick if o and not o.effects[-1].is_twin), key=lambda other: other.loss)
        best = search.continued(ranked[0]) if ranked else None
        if best and best.loss < h.loss - BETTER:
            search.rivals.setdefault(place(best.effects[-1]), []).append(effect)
            search.report(f"  {effect.name()} exchanged", best)
            return exchanged(search, search.refined(best))
    return h


def doubtful(search: Search, h: Hypothesis) -> list[int]:
    """Return the numbers of the effects whose joints are strained or above the floor, the furthest above it first."""
    rest, far = dict(zip(search.train.nominal.joints, search.ratio(h), strict=True)), strained(h)
    own = [(effect.joint, number) for number, effect in enumerate(h.effects) if effect.joint]
    above = [(rest[joint], number) for joint, number in own if rest[joint] > UNSATISFIED or joint in far]
    return [number for _, number in sorted(above, reverse=True)[:DOUBTED]]


def tried(search: Search, rest: Hypothesis, candidate: Candidate) -> Hypothesis | None:
    """Fit a candidate for a few steps beside the effects that stay."""
    return search.fitted((*rest.effects, candidate.effect), candidate.factors, rest.fit, steps=3)
