"""Add the effect that helps most, and with it those of other joints."""

from collections.abc import Sequence

from nas_data.gap.search.fit import Fit
from nas_data.gap.search.hypothesis import (
    PRICE,
    Description,
    Hypothesis,
    frees_base_parameter,
    key,
)
from nas_data.gap.search.moves import optional_parameters
from nas_data.gap.search.screen import Candidate
from nas_data.gap.search.search import FAR_BEHIND, TRIED, Search
from nas_data.gap.side_by_side import side_by_side

BUNDLED = 2  # effects that are tried in all joints at once
DOUBTFUL = 2.0  # noise floors of rest above which every effect of a joint is fitted before the search ends
WORST = 2  # joints of which every effect is fitted then
PROMISE = 2.5  # nats by which the first order must lower the loss of every other episode, or a candidate is not fitted
SLACK = 30.0  # nats that the first order may be wrong by there around the unfitted model
SHORTLIST = 6  # candidates that are fitted, of those screened
LOOKED_AHEAD = 2  # effects in several joints that are followed one step further, where nothing is named yet


def apply(search: Search, h: Hypothesis) -> Hypothesis:
    """Add the best effect, from the model as it is and from the present fit; last, what the first order overlooks."""
    around = h.fit if h.effects or h.description.freed else search.nominal.fit
    ranked = extensions(search, h, around)
    better = add_best(search, h, ranked if h.effects else look_ahead(search, h, ranked))
    if better is h and around is not h.fit:
        better = add_best(search, h, extensions(search, h, h.fit))
    return add_best(search, h, fit_worst_joints(search, h)) if better is h else better


def add_first(search: Search) -> Hypothesis:
    """Add the best effect to the model as it is, in as many joints as need it, without looking a step ahead."""
    return add_best(search, search.null, extensions(search, search.null, search.nominal.fit))


def add_best(search: Search, kept: Hypothesis, ranked: Sequence[Hypothesis]) -> Hypothesis:
    """Add the best effect, and with it the best of other joints where each is worth its price."""
    useful = [h for h in ranked if h.score < kept.score]
    if not useful:
        return kept
    remember(search, kept, ranked)
    best = useful[0]
    for other in useful[1:]:
        added, before = other.effects[len(kept.effects) :], best.effects[len(kept.effects) :]
        taken = {effect.joint for effect in before}
        if len(added) > 1 or added[0].joint in {None, *taken} or None in taken:
            continue
        both = search.fitted(best.description.adding(*added), best.fit.factors, best.fit, steps=3)
        if both and both.score < best.score:
            best = both
    return best


def extensions(search: Search, kept: Hypothesis, around: Fit) -> list[Hypothesis]:
    """Return the hypotheses that one more effect makes, best first."""
    wanted = search.above_floor(kept)
    search.say(f"  screening every effect at {', '.join(sorted(wanted)) or 'no joint'}")
    found, reach = search.screened(around, kept, wanted)
    search.say(f"  fitting the best of {len(found)} candidates")
    chosen = shortlist(found, reach.nats - PROMISE, SLACK if around is search.nominal.fit else 0.0)
    chosen += [c for c in found if c not in chosen and frees_base_parameter(kept, c.effect)]
    ranked = fit_candidates(search, kept, around, chosen)
    ranked = sorted([*ranked, *bundles(search, kept, ranked, found, reach.nats, around)], key=lambda h: h.score)
    for h in ranked[:4]:
        search.report("  tried", h)
    return ranked


def shortlist(found: Sequence[Candidate], reach: float, slack: float) -> list[Candidate]:
    """Return the candidates that are worth a fit: the best of each joint, and the best of all.

    Args:
        found: Candidates, the most promising first.
        reach: First-order loss below which a candidate promises enough.
        slack: By how much the first order may be too high.
    """
    leaders: dict[str | None, Candidate] = {}
    for candidate in found:
        if candidate.loss.nats < reach:
            leaders.setdefault(candidate.effect.joint, candidate)
    others = [c for c in found if c.loss.nats < reach + slack and leaders.get(c.effect.joint) is not c]
    chosen = [*leaders.values(), *others[: max(SHORTLIST - len(leaders), TRIED)]]
    return sorted(chosen, key=lambda candidate: candidate.loss)


def fit_worst_joints(search: Search, kept: Hypothesis) -> list[Hypothesis]:
    """Return what every effect of the worst joints makes, best first: the first order is blind to some.

    A dead band beside dry friction does nothing until it is wide enough, and a model fitted without an effect bends
    far from where it belongs.
    """
    rest = zip(search.ratio(kept), search.train.nominal.joints, strict=True)
    left = sorted(((r, joint) for r, joint in rest if r > DOUBTFUL and joint in search.excited), reverse=True)
    worst = {joint for _, joint in left[:WORST]}
    if not worst:
        return []
    found, _ = search.screened(kept.fit, kept, worst)
    ranked = fit_candidates(search, kept, kept.fit, [c for c in found if c.effect.joint])
    for h in ranked[:2]:
        search.report("  overlooked?", h)
    return ranked


def beside(kept: Hypothesis, around: Fit, candidate: Candidate) -> Description:
    """Return the description with a candidate, the others where the first order puts them."""
    others = around.parameters.effects_at(candidate.theta)
    description = kept.description if around is kept.fit else Description()
    return description.with_effects(others).adding(candidate.effect)


def fit_candidates(search: Search, kept: Hypothesis, around: Fit, candidates: Sequence[Candidate]) -> list[Hypothesis]:
    """Fit candidates beside what is there for a few steps, and the best of them further; best first."""

    def fit_briefly(c: Candidate) -> Hypothesis | None:
        factors = around.parameters.factors_at(c.theta)
        return search.fitted(beside(kept, around, c), factors, around, steps=2)

    quick = side_by_side(fit_briefly, candidates)
    ranked = sorted((h for h in quick if h and not h.effects[-1].has_preferred_equivalent), key=lambda h: h.score)
    ahead = [h for h in ranked if h.score < ranked[0].score + FAR_BEHIND][:TRIED]
    thorough = side_by_side(lambda h: optional_parameters.apply(search, search.continued(h)), ahead)
    return sorted([*thorough, *ranked[len(ahead) :]], key=lambda h: h.score)


def bundles(
    search: Search,
    kept: Hypothesis,
    ranked: Sequence[Hypothesis],
    found: Sequence[Candidate],
    reach: float,
    around: Fit,
) -> list[Hypothesis]:
    """Return what the best effects do in all joints at once: servos of one make lack the same."""
    names = dict.fromkeys(h.effects[-1].name() for h in ranked if h.effects[-1].joint and h.score < kept.score)
    useful = [c for c in found if c.effect.joint and c.loss.nats < reach - PRICE]
    alike = [[c for c in useful if c.effect.name() == name] for name in list(names)[:BUNDLED]]
    fitted = []
    for group in alike:
        if len(group) > 1:
            description = beside(kept, around, group[0]).adding(*(c.effect for c in group[1:]))
            factors = around.parameters.factors_at(group[0].theta)
            fitted.append(search.fitted(description, factors, around, steps=4))
    return [search.continued(h) for h in fitted if h]  # many numbers at once are far from where they end


def look_ahead(search: Search, kept: Hypothesis, ranked: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Return hypotheses best first; those with one effect in several joints are continued by one more step.

    A servo far softer than its model needs friction beside it before it explains what a dead band explains alone: where
    all joints lack the same two things, the first of them may look worse by itself than a wrong one. One that brings
    every joint to the floor needs no such look.
    """
    several = [h for h in ranked if len(h.effects) > len(kept.effects) + 1 and h.score < kept.score][:LOOKED_AHEAD]
    if len(several) < LOOKED_AHEAD or ranked[0] is not several[0] or not search.above_floor(ranked[0]):
        return list(ranked)
    leads = [min([h, *extensions(search, h, h.fit)], key=lambda one: one.score) for h in several]
    best = min(leads, key=lambda one: one.score)
    search.report("  looked ahead", best)
    return [best, *ranked]


def remember(search: Search, kept: Hypothesis, ranked: Sequence[Hypothesis]) -> None:
    """Note which effects competed for a joint, and whether the best of all left every other far behind."""
    if len(ranked) < 2 or ranked[1].score.over(ranked[0].score) > FAR_BEHIND:
        search.clear.add(frozenset(map(key, ranked[0].effects)))
    ranked = [h for h in ranked if len(h.effects) == len(kept.effects) + 1]
    for h in ranked:
        added = h.effects[-1]
        near = [o.effects[-1] for o in ranked if o is not h and added.joint in (o.effects[-1].joint, None)]
        search.rivals.setdefault(key(added), []).extend(near)
