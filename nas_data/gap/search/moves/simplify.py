"""Replace effects by special cases with fewer parameters, or by what the model alone can express."""

import math
from collections.abc import Container

from nas_data.effects.base import Effect, find_effect, make_effect
from nas_data.gap.search.constants import MAX_LEADERS
from nas_data.gap.search.fit import Fit
from nas_data.gap.search.hypothesis import Description, Hypothesis, effect_key
from nas_data.gap.search.moves.add import add_candidate
from nas_data.gap.search.search import Search
from nas_data.gap.side_by_side import map_in_parallel

Start = tuple[Description, dict[str, float], Fit | None]  # description, factors of the model, fit with known columns


def apply(search: Search, h: Hypothesis) -> Hypothesis:
    """Try the special cases of each effect, and keep one if the score falls."""
    waiting = [effect_key(effect) for effect in reversed(h.effects)]
    while waiting:
        key = waiting.pop()
        number = next((n for n, effect in enumerate(h.effects) if effect_key(effect) == key), None)
        if number is None:
            continue
        best = min(fit_special_cases(search, h, number), key=lambda one: one.score, default=h)
        if best.score < h.score:
            found = effect_key(best.effects[-1])
            if found != key:
                search.rivals.setdefault(found, []).append(h.effects[number])
            search.report(f"{h.effects[number].name()} simplified", best)
            waiting.append(found)
            h = best
    return h


def fit_special_cases(search: Search, h: Hypothesis, number: int) -> list[Hypothesis]:
    """Fit a hypothesis with special cases in place of one effect; empty if it has none."""
    effect = h.effects[number]
    simpler = [find_effect(name) for name in effect.confused_with]
    names = {kind.name() for kind in simpler if count_parameters(kind) < count_parameters(type(effect))}
    if effect.local_joint is None or effect.name() in h.description.shared:
        return []
    starts = [*replace_hook(search, h, number), *fix_optional_parameters(h, number)]
    if names:
        starts += [*absorb(h, effect, names), *replace_by_simpler(search, h, number, names)]
    fitted = map_in_parallel(lambda start: search.fit_description(*start, jacobian_refreshes=1), starts)
    return [one for one in fitted if one]


def replace_hook(search: Search, h: Hypothesis, number: int) -> list[Start]:
    """Return a start in which the nearest effect of the model file replaces one that needs a hook, if it is free."""
    effect = h.effects[number]
    if effect.in_model or effect.joint is None:
        return []
    nearest = effect.nearest_in_model(search.find_scales(effect.joint))
    if nearest is None or effect_key(nearest) in map(effect_key, h.effects):
        return []
    return [(h.description.without_effect(number).add_effects(nearest), h.fit.factors, h.fit)]


def fix_optional_parameters(h: Hypothesis, number: int) -> list[Start]:
    """Return a start in which an effect has no optional parameters, if it has some."""
    effect = h.effects[number]
    simpler = effect.without_optional_parameters()
    if simpler == effect:
        return []
    others = [one for one in h.effects if one is not effect]
    return [(h.description.with_effects([*others, simpler]), h.fit.factors, None)]


def absorb(h: Hypothesis, effect: Effect, names: Container[str]) -> list[Start]:
    """Return starts in which a special case replaces an effect, with the sum of both sizes as initial value.

    Two kinds of friction can share one torque in any ratio, and a fit from a part of it does not reach the sum. All
    other parameters keep their values.
    """
    starts: list[Start] = []
    for kind in (find_effect(name) for name in effect.confused_with if name in names):
        if all(parameter in effect.parameters for parameter in kind.parameters):
            both = (effect_key(effect), (kind.name(), effect.joint))
            sizes = {
                p.name: sum(getattr(e, p.name) for e in h.effects if effect_key(e) in both) for p in kind.parameters
            }
            others = [e for e in h.effects if effect_key(e) not in both]
            whole = make_effect(kind.name(), effect.joint, sizes)
            starts.append((h.description.with_effects(others).add_effects(whole), h.fit.factors, None))
    return starts


def replace_by_simpler(search: Search, h: Hypothesis, number: int, names: Container[str]) -> list[Start]:
    """Return starts with the most promising of the simpler effects in place of an effect."""
    joint, rest = h.effects[number].joint, search.without_effect(h, number)
    if rest is None or joint is None:
        return []
    found, _ = search.screen_candidates(rest.fit, rest, {joint})
    chosen = [c for c in found if c.effect.name() in names and c.effect.joint == joint][:MAX_LEADERS]
    return [(add_candidate(rest, rest.fit, c), rest.fit.parameters.factors_at(c.theta), rest.fit) for c in chosen]


def count_parameters(kind: type[Effect]) -> int:
    """Return the number of parameters of an effect, without optional ones that have no prior."""
    return sum(parameter.spread < math.inf for parameter in kind.parameters)
