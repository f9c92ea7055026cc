"""Swap effects that may only stand in for others: the first found is not always the right one."""

from functools import partial

from nas_data.gap.search.hypothesis import Hypothesis, frees_base_parameter, joints_beyond_prior, key
from nas_data.gap.search.moves.add import beside
from nas_data.gap.search.screen import Candidate
from nas_data.gap.search.search import FAR_BEHIND, TRIED, Search
from nas_data.gap.side_by_side import side_by_side

UNSATISFIED = 1.25  # noise floors above which other effects are tried in the place of one that was found
MANY = 8  # effects from which others are tried only in the place of the most doubted one
SWAPPED = 4  # effects that are tried there


def apply(search: Search, h: Hypothesis) -> Hypothesis:
    """Try other effects in the place of each that is doubted: the first found may only stand in."""
    if (keys := frozenset(map(key, h.effects))) in search.settled:
        return h
    search.settled.add(keys)
    for number in doubtful(search, h):
        effect, rest = h.effects[number], search.without(h, number)
        if rest is None:
            continue
        found, reach = search.screened(rest.fit, h, {effect.joint} if effect.joint else joints_beyond_prior(h))
        found = [c for c in found if c.place != key(effect)]
        own = [c for c in found if frees_base_parameter(h, c.effect)]
        near = [c for c in found if c.effect.joint and effect.joint][:SWAPPED]
        others = [c for c in near if c.loss.over(reach) < FAR_BEHIND and c not in own] + own
        quick = side_by_side(partial(fit_briefly, search, rest), others)
        ranked = sorted(
            (o for o in quick if o and not o.effects[-1].has_preferred_equivalent), key=lambda other: other.score
        )
        best = search.continued(ranked[0]) if ranked else None
        if best and best.score < h.score:
            search.rivals.setdefault(key(best.effects[-1]), []).append(effect)
            search.report(f"  {effect.name()} swapped", best)
            return apply(search, best)
    return h


def doubtful(search: Search, h: Hypothesis) -> list[int]:
    """Return the numbers of the effects whose joints are above the floor or bend the model, the furthest above first.

    An effect of the whole arm is doubted last, and only where a joint bends the model.
    """
    rest, bent = dict(zip(search.train.nominal.joints, search.ratio(h), strict=True)), joints_beyond_prior(h)
    own = [(rest.get(effect.joint or "", 0.0), effect.joint, number) for number, effect in enumerate(h.effects)]
    above = [
        (left, number) for left, joint, number in own if left > UNSATISFIED or joint in bent or (bent and not joint)
    ]
    return [number for _, number in sorted(above, reverse=True)[: TRIED if len(h.effects) <= MANY else 1]]


def fit_briefly(search: Search, rest: Hypothesis, candidate: Candidate) -> Hypothesis | None:
    """Fit a candidate with its optional parameters for a few steps beside the effects that stay."""
    description = beside(rest, rest.fit, candidate)
    description = description.with_effects(
        [*description.effects[:-1], description.effects[-1].with_optional_parameters()]
    )
    return search.fitted(description, rest.fit.parameters.factors_at(candidate.theta), rest.fit, steps=3)
