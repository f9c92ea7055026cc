"""Let a hypothesis grow: add the effect that helps most, and with it those of other joints."""

from collections.abc import Sequence

import numpy as np

from nas_data.gap.search.detail import detailed
from nas_data.gap.search.fit import Fit
from nas_data.gap.search.hypothesis import GAIN, Hypothesis, place, relief, relieves, shortened, strained, worth
from nas_data.gap.search.screen import Candidate
from nas_data.gap.search.state import Search
from nas_data.gap.side_by_side import side_by_side

FINALISTS = 3  # short fits that are continued
MOST = 4  # effects for each joint of an arm
AT_FLOOR = 1.15  # noise floors below which nothing is looked for
BUNDLED = 2  # effects that are tried in all joints at once
DOUBTFUL = 2.0  # noise floors of rest above which every effect of a joint is fitted before the search ends
WORST = 2  # joints of which every effect is fitted then
PROMISE = 2.5  # nats by which the first order must lower the loss of every other episode, or a candidate is not fitted
SLACK = 30.0  # nats that the first order may be wrong by there around the unfitted model
CHANCE = 80.0  # nats by which a short fit may lie behind the best and still be continued
NOTICEABLE = 0.95  # held-out error of the most improved joint below which an effect is added for now


def is_full(search: Search, h: Hypothesis) -> bool:
    """Whether a hypothesis has as many effects as any arm is given."""
    return len(h.effects) >= MOST * len(search.train.nominal.joints)


def grown(search: Search, kept: Hypothesis, ranked: Sequence[Hypothesis]) -> Hypothesis | None:
    """Add the best effect, and with it the best of other joints where each lowers the loss by its own; or None."""
    useful = [h for h in ranked if worth(kept) - worth(h) > 0 and promising(search, kept, h)]
    if not useful:
        return None
    remember(search, kept, ranked)
    best = useful[0]
    for other in useful[1:]:
        added, before = other.effects[len(kept.effects) :], best.effects[len(kept.effects) :]
        taken = {effect.joint for effect in before}
        if len(added) > 1 or added[0].joint in {None, *taken} or None in taken or is_full(search, best):
            continue
        both = search.fitted((*best.effects, *added), best.fit.factors, best.fit, steps=3)
        if both and best.loss - both.loss > max(GAIN, 0.5 * (kept.loss - other.loss)):
            best = both
    return best


def extensions(search: Search, kept: Hypothesis, around: Fit) -> list[Hypothesis]:
    """Return the hypotheses that one more effect makes, best first."""
    ratios = zip(search.train.nominal.joints, search.ratio(kept), strict=True)
    wanted = {joint for joint, ratio in ratios if ratio > AT_FLOOR} | strained(kept)
    wanted &= search.lively
    found, reach = search.screened(around, kept, wanted)
    shortlist = shortened(found, reach - PROMISE, SLACK if around is search.nominal.fit else 0.0)
    shortlist += [c for c in found if c not in shortlist and relief(kept, c.effect)]
    ranked = fitted_on(search, around, shortlist)
    ranked = sorted([*ranked, *bundles(search, kept, ranked, found, reach, around)], key=worth)
    for h in ranked[:4]:
        search.report("  tried", h)
    return ranked


def overlooked(search: Search, kept: Hypothesis) -> list[Hypothesis]:
    """Return what every effect of the worst joints makes, best first: the first order is blind to some.

    A dead band beside dry friction does nothing until it is wide enough, and a base fitted without an effect bends
    far from where it belongs.
    """
    rest = zip(search.ratio(kept), search.train.nominal.joints, strict=True)
    left = sorted(((r, joint) for r, joint in rest if r > DOUBTFUL and joint in search.lively), reverse=True)
    worst = {joint for _, joint in left[:WORST]}
    if not worst:
        return []
    found, _ = search.screened(kept.fit, kept, worst)
    ranked = fitted_on(search, kept.fit, [c for c in found if c.effect.joint])
    for h in ranked[:2]:
        search.report("  overlooked?", h)
    return ranked


def fitted_on(search: Search, around: Fit, candidates: Sequence[Candidate]) -> list[Hypothesis]:
    """Fit candidates beside what is there for a few steps, and the best of them further; best first."""
    quick = side_by_side(
        lambda c: search.fitted((*around.effects, c.effect), c.factors, around, steps=2),
        candidates,
    )
    ranked = sorted((h for h in quick if h and not h.effects[-1].is_twin), key=lambda h: h.loss)
    ahead = [h for h in ranked if h.loss < ranked[0].loss + CHANCE][:FINALISTS]
    thorough = side_by_side(lambda h: detailed(search, search.continued(h)), ahead)
    return sorted([*thorough, *ranked[len(ahead) :]], key=lambda h: h.loss)


def bundles(
    search: Search,
    kept: Hypothesis,
    ranked: Sequence[Hypothesis],
    found: Sequence[Candidate],
    reach: float,
    around: Fit,
) -> list[Hypothesis]:
    """Return what the best effects do in all joints at once: servos of one make lack the same."""
    names = dict.fromkeys(h.effects[-1].name() for h in ranked if h.effects[-1].joint and kept.loss - h.loss > GAIN)
    useful = [c for c in found if c.effect.joint and c.misfit < reach - GAIN]
    alike = [[c for c in useful if c.effect.name() == name] for name in list(names)[:BUNDLED]]
    fitted = [
        search.fitted((*around.effects, *(c.effect for c in group)), group[0].factors, around, steps=4)
        for group in alike
        if len(group) > 1
    ]
    return [search.continued(h) for h in fitted if h]  # many numbers at once are far from where they end


def remember(search: Search, kept: Hypothesis, ranked: Sequence[Hypothesis]) -> None:
    """Note which effects competed for a joint."""
    ranked = [h for h in ranked if len(h.effects) == len(kept.effects) + 1]
    for h in ranked:
        added = h.effects[-1]
        near = [o.effects[-1] for o in ranked if o is not h and added.joint in (o.effects[-1].joint, None)]
        search.rivals.setdefault(place(added), []).extend(near)


def promising(search: Search, without: Hypothesis, with_: Hypothesis) -> bool:
    """Whether more effects lower the held-out error at all, and of one joint by what could be worth a name."""
    logs = search.logs(without, with_).mean(0)
    noticed = np.exp(logs.min()) <= NOTICEABLE or relieves(without, with_)
    return bool(logs.sum() < 0 and noticed)
