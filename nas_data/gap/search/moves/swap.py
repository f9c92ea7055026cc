"""Replace effects by others with a better score, because the first effect found is not always the right one."""

from functools import partial

from nas_data.gap.search.constants import FAR_BEHIND, LARGE_SIZE, MAX_ALTERNATIVES
from nas_data.gap.search.hypothesis import Hypothesis, can_free_base_parameter, effect_key, find_joints_beyond_prior
from nas_data.gap.search.moves.add import add_candidate
from nas_data.gap.search.screen import Candidate
from nas_data.gap.search.search import Search
from nas_data.gap.side_by_side import map_in_parallel


def apply(search: Search, h: Hypothesis) -> Hypothesis:
    """Try other effects in place of each doubtful one."""
    if (keys := frozenset(map(effect_key, h.effects))) in search.swaps_tried:
        return h
    search.swaps_tried.add(keys)
    for number in find_doubtful(search, h):
        effect, rest = h.effects[number], search.without_effect(h, number)
        if rest is None:
            continue
        found, kept_loss = search.screen_candidates(
            rest.fit, h, {effect.local_joint} if effect.local_joint else find_joints_beyond_prior(h)
        )
        found = [c for c in found if c.effect_key != effect_key(effect)]
        own = [c for c in found if can_free_base_parameter(h, c.effect)]
        near = [c for c in found if c.effect.local_joint and effect.local_joint][:MAX_ALTERNATIVES]
        others = [c for c in near if c.loss.over(kept_loss) < FAR_BEHIND and c not in own] + own
        quick = map_in_parallel(partial(fit_briefly, search, rest), others)
        ranked = sorted((o for o in quick if o and not search.ends_with_equivalent(o)), key=lambda other: other.score)
        best = search.fit_further(ranked[0]) if ranked else None
        if best and best.score < h.score:
            search.rivals.setdefault(effect_key(best.effects[-1]), []).append(effect)
            search.report(f"  {effect.name()} swapped", best)
            return apply(search, best)
    return h


def find_doubtful(search: Search, h: Hypothesis) -> list[int]:
    """Return the indices of effects in joints above the floor or beyond their prior, largest error first.

    An effect of the whole arm comes last, and only if a joint is beyond its prior.
    """
    rest, bent = (
        dict(zip(search.train.nominal.joints, search.floor_ratios(h), strict=True)),
        find_joints_beyond_prior(h),
    )
    places = [effect.local_joint for effect in h.effects]
    own = [(rest.get(joint or "", 0.0), joint, number) for number, joint in enumerate(places)]
    above = [
        (left, number) for left, joint, number in own if left > search.at_floor or joint in bent or (bent and not joint)
    ]
    return [
        number for _, number in sorted(above, reverse=True)[: MAX_ALTERNATIVES if len(h.effects) <= LARGE_SIZE else 1]
    ]


def fit_briefly(search: Search, rest: Hypothesis, candidate: Candidate) -> Hypothesis | None:
    """Fit a candidate with its optional parameters for a few steps beside the other effects."""
    description = add_candidate(rest, rest.fit, candidate)
    *others, added = description.effects
    scales = search.find_scales(added.joint) if added.joint else None
    description = description.with_effects([*others, added.with_optional_parameters(scales)])
    return search.fit_description(description, rest.fit.parameters.factors_at(candidate.theta), rest.fit, steps=3)
