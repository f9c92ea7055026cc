"""Replace effects by special cases with fewer parameters."""

from collections.abc import Container

from nas_data.effects.base import Effect, find_effect, make_effect
from nas_data.gap.search.constants import LEADERS
from nas_data.gap.search.hypothesis import Hypothesis, effect_key
from nas_data.gap.search.moves.add import add_candidate
from nas_data.gap.search.search import Search


def apply(search: Search, h: Hypothesis) -> Hypothesis:
    """Try the special cases of each effect, and keep one if the score falls."""
    for number, effect in enumerate(h.effects):
        simpler = [find_effect(name) for name in effect.confused_with]
        names = {kind.name() for kind in simpler if len(kind.parameters) < len(effect.parameters)}
        if not names or effect.joint is None or effect.name() in h.description.shared:
            continue
        fitted = [*absorb(search, h, effect, names), *replace_by_simpler(search, h, number, names)]
        best = min(fitted, key=lambda one: one.score, default=h)
        if best.score < h.score:
            search.rivals.setdefault(effect_key(best.effects[-1]), []).append(effect)
            search.report(f"{effect.name()} simplified", best)
            return apply(search, best)
    return h


def absorb(search: Search, h: Hypothesis, effect: Effect, names: Container[str]) -> list[Hypothesis]:
    """Fit a hypothesis in which a special case replaces an effect, with the sum of both sizes as initial value.

    Two kinds of friction can share one torque in any ratio, and a fit from a part of it does not reach the sum. All
    other parameters keep their values.
    """
    fitted = []
    for kind in (find_effect(name) for name in effect.confused_with if name in names):
        if all(parameter in effect.parameters for parameter in kind.parameters):
            both = (effect_key(effect), (kind.name(), effect.joint))
            sizes = {
                p.name: sum(getattr(e, p.name) for e in h.effects if effect_key(e) in both) for p in kind.parameters
            }
            others = [e for e in h.effects if effect_key(e) not in both]
            whole = make_effect(kind.name(), effect.joint, sizes)
            description = h.description.with_effects(others).add_effects(whole)
            fitted.append(search.fit_description(description, h.fit.factors, jacobian_refreshes=1))
    return [one for one in fitted if one]


def replace_by_simpler(search: Search, h: Hypothesis, number: int, names: Container[str]) -> list[Hypothesis]:
    """Fit the most promising of the simpler effects in place of an effect."""
    joint, rest = h.effects[number].joint, search.without_effect(h, number)
    if rest is None or joint is None:
        return []
    found, _ = search.screen_candidates(rest.fit, rest, {joint})
    chosen = [c for c in found if c.effect.name() in names and c.effect.joint == joint][:LEADERS]
    fitted = [
        search.fit_description(
            add_candidate(rest, rest.fit, c), rest.fit.parameters.factors_at(c.theta), rest.fit, jacobian_refreshes=1
        )
        for c in chosen
    ]
    return [one for one in fitted if one]
