"""Put a special case in the place of an effect of more parameters, where the data do not need the others."""

from collections.abc import Container

from nas_data.effects.base import Effect, find_effect, make_effect
from nas_data.gap.search.hypothesis import Hypothesis, key
from nas_data.gap.search.moves.add import beside
from nas_data.gap.search.search import Search

SIMPLER = 2  # effects of fewer parameters that are tried in the place of one


def apply(search: Search, h: Hypothesis) -> Hypothesis:
    """Try the special cases of each effect, which take its size over."""
    for number, effect in enumerate(h.effects):
        simpler = [find_effect(name) for name in effect.confused_with]
        names = {kind.name() for kind in simpler if len(kind.parameters) < len(effect.parameters)}
        if not names or effect.joint is None or effect.name() in h.description.shared:
            continue
        fitted = [*absorb(search, h, effect, names), *replace_by(search, h, number, names)]
        best = min(fitted, key=lambda one: one.score, default=h)
        if best.score < h.score:
            search.rivals.setdefault(key(best.effects[-1]), []).append(effect)
            search.report(f"{effect.name()} simplified", best)
            return apply(search, best)
    return h


def absorb(search: Search, h: Hypothesis, effect: Effect, names: Container[str]) -> list[Hypothesis]:
    """Return what is left of a hypothesis when a special case of an effect takes its size over, and its own besides.

    Two kinds of friction share one torque in any way, and left alone with its part the simpler one never gets to the
    whole. All else begins where it was: what an effect hides is rarely found from where nothing hides it.
    """
    fitted = []
    for kind in (find_effect(name) for name in effect.confused_with if name in names):
        if all(parameter in effect.parameters for parameter in kind.parameters):
            both = (key(effect), (kind.name(), effect.joint))
            sizes = {p.name: sum(getattr(e, p.name) for e in h.effects if key(e) in both) for p in kind.parameters}
            others = [e for e in h.effects if key(e) not in both]
            whole = make_effect(kind.name(), effect.joint, sizes)
            description = h.description.with_effects(others).adding(whole)
            fitted.append(search.fitted(description, h.fit.factors, jacobian_refreshes=1))
    return [one for one in fitted if one]


def replace_by(search: Search, h: Hypothesis, number: int, names: Container[str]) -> list[Hypothesis]:
    """Return the hypotheses with one of some simpler effects in the place of an effect, those that promise most."""
    joint, rest = h.effects[number].joint, search.without(h, number)
    if rest is None or joint is None:
        return []
    found, _ = search.screened(rest.fit, rest, {joint})
    chosen = [c for c in found if c.effect.name() in names and c.effect.joint == joint][:SIMPLER]
    fitted = [
        search.fitted(
            beside(rest, rest.fit, c), rest.fit.parameters.factors_at(c.theta), rest.fit, jacobian_refreshes=1
        )
        for c in chosen
    ]
    return [one for one in fitted if one]
