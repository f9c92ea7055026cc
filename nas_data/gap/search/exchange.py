"""Exchange effects that may only stand in for others: the first found is not always the right one."""

from functools import partial

from nas_data.gap.search.hypothesis import MANY, Hypothesis, place, relief, strained
from nas_data.gap.search.screen import Candidate
from nas_data.gap.search.state import FAR_BEHIND, Search
from nas_data.gap.side_by_side import side_by_side

UNSATISFIED = 1.25  # noise floors above which other effects are tried in the place of one that was found
DOUBTED = 3  # effects in whose place others are tried; where there are many, only the most doubted one's
BETTER = 4.0  # nats by which another effect must lower the loss
EXCHANGED = 4  # effects that are tried there


def exchanged(search: Search, h: Hypothesis) -> Hypothesis:
    """Try other effects in the place of each that is doubted: the first found may only stand in."""
    if (places := frozenset(map(place, h.effects))) in search.settled:
        return h
    search.settled.add(places)
    for number in doubtful(search, h):
        effect, rest = h.effects[number], search.without(h, number)
        if rest is None:
            continue
        found, reach = search.screened(rest.fit, h, {effect.joint} if effect.joint else strained(h))
        found = [c for c in found if c.place != place(effect)]
        own = [c for c in found if relief(h, c.effect)]
        near = [c for c in found if c.effect.joint and effect.joint][:EXCHANGED]
        others = [c for c in near if c.misfit < reach + FAR_BEHIND and c not in own] + own
        quick = side_by_side(partial(tried, search, rest), others)
        ranked = sorted((o for o in quick if o and not o.effects[-1].is_twin), key=lambda other: other.loss)
        best = search.continued(ranked[0]) if ranked else None
        if best and best.loss < h.loss - BETTER:
            search.rivals.setdefault(place(best.effects[-1]), []).append(effect)
            search.report(f"  {effect.name()} exchanged", best)
            return exchanged(search, search.refined(best))
    return h


def doubtful(search: Search, h: Hypothesis) -> list[int]:
    """Return the numbers of the effects whose joints are strained or above the floor, the furthest above it first.

    An effect of the whole arm is doubted last, and only where a joint is strained.
    """
    rest, far = dict(zip(search.train.nominal.joints, search.ratio(h), strict=True)), strained(h)
    own = [(rest.get(effect.joint or "", 0.0), effect.joint, number) for number, effect in enumerate(h.effects)]
    above = [(left, number) for left, joint, number in own if left > UNSATISFIED or joint in far or (far and not joint)]
    return [number for _, number in sorted(above, reverse=True)[: DOUBTED if len(h.effects) <= MANY else 1]]


def tried(search: Search, rest: Hypothesis, candidate: Candidate) -> Hypothesis | None:
    """Fit a candidate with its details for a few steps beside the effects that stay."""
    return search.fitted((*rest.effects, candidate.effect.detailed()), candidate.factors, rest.fit, steps=3)
