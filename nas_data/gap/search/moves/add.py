"""Add the effect with the best score, and the same or others in further joints."""

from collections.abc import Sequence

from nas_data.count_of import count_of
from nas_data.gap.search.constants import (
    EXPLAINED,
    FAR_BEHIND,
    LARGE_SIZE,
    MAX_ALTERNATIVES,
    MAX_LEADERS,
    PARAMETER_PRICE,
    PRICE,
    SHORTLIST,
)
from nas_data.gap.search.fit import Fit
from nas_data.gap.search.hypothesis import (
    Description,
    Hypothesis,
    can_free_base_parameter,
    effect_key,
)
from nas_data.gap.search.moves import optional_parameters
from nas_data.gap.search.screen import Candidate
from nas_data.gap.search.search import Search
from nas_data.gap.side_by_side import map_in_parallel


def apply(search: Search, h: Hypothesis) -> Hypothesis:
    """Add the best effect: screened around the model, then around the present fit.

    If a hypothesis has few effects, every effect of the worst joints is tried last, without screening.
    """
    around = h.fit if h.effects or h.description.freed else search.nominal.fit
    ranked = extend(search, h, around)
    better = add_best(search, h, ranked if h.effects else look_ahead(search, h, ranked))
    if better is h and around is not h.fit:
        better = add_best(search, h, extend(search, h, h.fit))
    if better is h and len(h.effects) <= LARGE_SIZE:
        better = add_best(search, h, fit_worst_joints(search, h))
    return better


def add_first(search: Search) -> Hypothesis:
    """Add the best effect to the given model, in all joints that need it, without looking ahead."""
    return add_best(search, search.null, extend(search, search.null, search.nominal.fit))


def add_best(search: Search, kept: Hypothesis, ranked: Sequence[Hypothesis]) -> Hypothesis:
    """Add the best effect, and further ones of other joints that are worth their price."""
    useful = [h for h in ranked if h.score < kept.score]
    if not useful:
        return kept
    record_rivals(search, kept, ranked)
    best = useful[0]
    for other in useful[1:]:
        added, before = other.effects[len(kept.effects) :], best.effects[len(kept.effects) :]
        taken = {effect.joint for effect in before}
        if len(added) != 1 or added[0].joint in {None, *taken} or None in taken:
            continue
        both = search.fit_description(best.description.add_effects(*added), best.fit.factors, best.fit, steps=3)
        if both and both.score < best.score:
            best = both
    return best


def extend(search: Search, kept: Hypothesis, around: Fit) -> list[Hypothesis]:
    """Return the hypotheses with one more effect, or one kind in several joints, sorted by score."""
    wanted = search.find_joints_above_floor(kept)
    search.say(f"  screening every effect at {', '.join(sorted(wanted)) or 'no joint'}")
    found, kept_loss = search.screen_candidates(around, kept, wanted)
    search.say(f"  fitting the best of {count_of(len(found), 'candidate')}")
    chosen = shortlist(found, kept_loss.nats - PARAMETER_PRICE, FAR_BEHIND if around is search.nominal.fit else 0.0)
    chosen += [c for c in found if c not in chosen and can_free_base_parameter(kept, c.effect)]
    ranked = fit_candidates(search, kept, around, chosen)
    ranked = sorted(
        [*ranked, *extend_all_joints(search, kept, ranked, found, kept_loss.nats, around)], key=lambda h: h.score
    )
    for h in ranked[:4]:
        search.report("  tried", h)
    return ranked


def shortlist(found: Sequence[Candidate], kept_loss: float, slack: float) -> list[Candidate]:
    """Return the candidates to fit: the best of each joint, then the best of all.

    Args:
        found: Candidates sorted by first-order loss.
        kept_loss: First-order loss that a candidate must fall below [nats].
        slack: Allowed error of the first order [nats].
    """
    leaders: dict[str | None, Candidate] = {}
    for candidate in found:
        if candidate.loss.nats < kept_loss:
            leaders.setdefault(candidate.effect.local_joint, candidate)
    others = [c for c in found if c.loss.nats < kept_loss + slack and leaders.get(c.effect.local_joint) is not c]
    chosen = [*leaders.values(), *others[: max(SHORTLIST - len(leaders), MAX_ALTERNATIVES)]]
    return sorted(chosen, key=lambda candidate: candidate.loss)


def fit_worst_joints(search: Search, kept: Hypothesis) -> list[Hypothesis]:
    """Fit every effect of the joints with the largest errors, and return the hypotheses sorted by score.

    The first order misses some effects. For example, a dead band beside dry friction has no effect until it is wide
    enough.
    """
    rest = zip(search.floor_ratios(kept), search.train.nominal.joints, strict=True)
    left = sorted(((r, joint) for r, joint in rest if r > EXPLAINED and joint in search.excited), reverse=True)
    worst = {joint for _, joint in left[:MAX_LEADERS]}
    if not worst:
        return []
    found, _ = search.screen_candidates(kept.fit, kept, worst)
    ranked = fit_candidates(search, kept, kept.fit, [c for c in found if c.effect.local_joint])
    for h in ranked[:2]:
        search.report("  overlooked?", h)
    return ranked


def add_candidate(kept: Hypothesis, around: Fit, candidate: Candidate) -> Description:
    """Return the description with a candidate, other effects moved to their first-order values."""
    others = around.parameters.effects_at(candidate.theta)
    description = kept.description if around is kept.fit else Description()
    return description.with_effects(others).add_effects(candidate.effect)


def fit_candidates(search: Search, kept: Hypothesis, around: Fit, candidates: Sequence[Candidate]) -> list[Hypothesis]:
    """Fit candidates for a few steps, the best of them further; return the hypotheses sorted by score."""

    def fit_briefly(c: Candidate) -> Hypothesis | None:
        factors = around.parameters.factors_at(c.theta)
        return search.fit_description(add_candidate(kept, around, c), factors, around, steps=2)

    quick = map_in_parallel(fit_briefly, candidates)
    ranked = sorted((h for h in quick if h and not search.ends_with_equivalent(h)), key=lambda h: h.score)
    # one that gains much may gain more than the best: its first-order estimate may be far from its value
    ahead = [h for h in ranked if h.score < ranked[0].score + FAR_BEHIND or kept.score.over(h.score) > FAR_BEHIND][
        :MAX_ALTERNATIVES
    ]
    thorough = map_in_parallel(lambda h: optional_parameters.apply(search, search.fit_further(h)), ahead)
    return sorted([*thorough, *ranked[len(ahead) :]], key=lambda h: h.score)


def extend_all_joints(
    search: Search,
    kept: Hypothesis,
    ranked: Sequence[Hypothesis],
    found: Sequence[Candidate],
    kept_loss: float,
    around: Fit,
) -> list[Hypothesis]:
    """Fit the best effects in all joints at once, because servos of one make often lack the same effect.

    Loads on several arms need their places to explain as much as other gains in all joints.
    """
    names = dict.fromkeys(h.effects[-1].name() for h in ranked if h.effects[-1].joint and h.score < kept.score)
    useful = [c for c in found if c.effect.joint and c.loss.nats < kept_loss - PRICE]
    alike = [[c for c in useful if c.effect.name() == name] for name in list(names)[:MAX_LEADERS]]
    fitted = []
    for group in alike:
        if len(group) > 1:
            description = add_candidate(kept, around, group[0]).add_effects(*(c.effect for c in group[1:]))
            factors = around.parameters.factors_at(group[0].theta)
            fitted.append(search.fit_description(description, factors, around, steps=4))
    further = [search.fit_further(h) for h in fitted if h]  # many parameters at once need more steps
    return [optional_parameters.apply(search, h) if h.effects[-1].per_link else h for h in further]


def look_ahead(search: Search, kept: Hypothesis, ranked: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Extend hypotheses with one effect in several joints by one more effect; return all sorted by score.

    If all joints lack the same two effects, the first of them alone may score worse than a wrong one. For example, a
    soft servo needs friction beside it before it explains what a dead band explains alone. Nothing is done if a
    hypothesis already explains every joint.
    """
    several = [h for h in ranked if len(h.effects) > len(kept.effects) + 1 and h.score < kept.score][:MAX_LEADERS]
    if len(several) < MAX_LEADERS or ranked[0] is not several[0] or not search.find_joints_above_floor(ranked[0]):
        return list(ranked)
    leads = [min([h, *extend(search, h, h.fit)], key=lambda one: one.score) for h in several]
    best = min(leads, key=lambda one: one.score)
    search.report("  looked ahead", best)
    return [best, *ranked]


def record_rivals(search: Search, kept: Hypothesis, ranked: Sequence[Hypothesis]) -> None:
    """Record which effects competed for a joint, and whether the best was far ahead of all others."""
    if len(ranked) < 2 or ranked[1].score.over(ranked[0].score) > FAR_BEHIND:
        search.clear_winners.add(frozenset(map(effect_key, ranked[0].effects)))
    ranked = [h for h in ranked if len(h.effects) == len(kept.effects) + 1]
    for h in ranked:
        added = h.effects[-1]
        near = [o.effects[-1] for o in ranked if o is not h and added.local_joint in (o.effects[-1].local_joint, None)]
        search.rivals.setdefault(effect_key(added), []).extend(near)
