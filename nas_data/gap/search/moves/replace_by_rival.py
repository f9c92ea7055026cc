"""Compare effects with rivals again, with all other effects known."""

from collections.abc import Sequence

from nas_data import registry
from nas_data.count_of import count_of
from nas_data.effects.base import Effect, find_effect, make_effect
from nas_data.gap.search.constants import (
    FAR_BEHIND,
    LARGE_SIZE,
    MAX_ALTERNATIVES,
    MAX_LEADERS,
    MAX_ROUNDS,
    TIE,
)
from nas_data.gap.search.hypothesis import Description, Hypothesis, effect_key
from nas_data.gap.search.moves.drop import estimate_losses
from nas_data.gap.search.plain_fit import SMOOTH_EFFECTS
from nas_data.gap.search.search import Search
from nas_data.gap.search.torque_scale import Start, find_sufficient_ratio, leave_out
from nas_data.gap.side_by_side import map_in_parallel

STIFFNESS = "servo_stiffness"  # effect


def apply(search: Search, h: Hypothesis) -> Hypothesis:
    """Replace effects by rivals with a better score, including those that only a hook can express.

    A single effect that was far ahead of every other candidate needs no comparison.
    """
    if len(h.effects) == 1 and frozenset(map(effect_key, h.effects)) in search.clear_winners:
        return h
    numbers = select_doubted(search, h)
    search.say(f"  fitting rivals of {len(numbers)} of {count_of(len(h.effects), 'effect')}")
    add_rivals(search, h, numbers)
    for _ in range(MAX_ROUNDS):
        found = find_better_rival(search, h, select_doubted(search, h))
        if found is None:
            return h
        h = search.fit_further(found)
    return h


def select_doubted(search: Search, h: Hypothesis) -> list[int]:
    """Return the indices of the effects to compare: all, or the ones of lowest saliency if there are many."""
    if len(h.effects) <= LARGE_SIZE:
        return list(range(len(h.effects)))
    losses = estimate_losses(search, h)
    return sorted(range(len(h.effects)), key=lambda number: losses[h.effects[number]])[:MAX_ALTERNATIVES]


def find_better_rival(search: Search, h: Hypothesis, numbers: Sequence[int]) -> Hypothesis | None:
    """Return the first hypothesis with a better score in which a rival replaces an effect; None without one."""
    for number in numbers:
        effect = h.effects[number]
        for found in fit_rivals(search, h, number):
            if found.score + compute_tie_price(effect, found.effects[-1]) < h.score:
                search.report(f"{effect.name()} replaced", found)
                remember_replaced(search, h, number, found)
                return found
    return None


def compute_tie_price(effect: Effect, rival: Effect) -> float:
    """Return the price of a rival [nats]: `TIE` if it replaces an effect that every plain fit has, such as an offset.

    It is negative the other way round. So the simpler of two effects is named where the data do not decide.
    """
    return TIE * ((effect.name() in SMOOTH_EFFECTS) - (rival.name() in SMOOTH_EFFECTS))


def remember_replaced(search: Search, h: Hypothesis, number: int, found: Hypothesis) -> None:
    """Note that an effect of a hypothesis and its rivals are rivals of the effect that replaced it."""
    effect = h.effects[number]
    others = [other for other in h.effects if other is not effect]
    search.rivals[effect_key(found.effects[-1])] = [effect, *list_rivals(search, effect, others)]


def add_rivals(search: Search, h: Hypothesis, numbers: Sequence[int]) -> None:
    """Screen for rivals: the most promising effects in place of each, and similar ones of the other form.

    Effects of the model file are compared with similar ones that need a hook, and vice versa. The order in which they
    were first tried depends on the effects known at that time.
    """
    for number in numbers:
        effect = h.effects[number]
        if effect.local_joint is None or effect.name() in h.description.shared:
            continue
        known = search.rivals.setdefault(effect_key(effect), [])
        faces_hook = any(is_confusable(effect, other) for other in find_other_forms(effect))
        if len(known) >= MAX_ALTERNATIVES and not faces_hook:
            continue
        without = search.without_effect(h, number) or search.null
        found, kept_loss = search.screen_candidates(without.fit, h, {effect.local_joint})
        met = {effect_key(effect), *map(effect_key, known)}
        near = [c for c in found if c.effect.local_joint and c.loss.over(kept_loss) < FAR_BEHIND]
        others = [c.effect for c in near if effect_key(c.effect) not in met]
        known.extend(others[: MAX_ALTERNATIVES - len(known)])
        hooked = [other for other in others if other.in_model != effect.in_model and is_confusable(effect, other)]
        known[:0] = [other for other in hooked if other not in known][:MAX_LEADERS]


def find_other_forms(effect: Effect) -> list[type[Effect]]:
    """Return the kinds of effects that need a hook if this one does not, and the other way round."""
    kinds = [find_effect(name) for name in registry.list_names("effects")]
    return [kind for kind in kinds if kind.in_model != effect.in_model]


def is_confusable(effect: Effect, other: Effect | type[Effect]) -> bool:
    """Whether one of two effects lists the other as similar."""
    return other.name() in effect.confused_with or effect.name() in other.confused_with


def fit_rivals(search: Search, h: Hypothesis, number: int) -> list[Hypothesis]:
    """Fit a hypothesis with each rival in place of one effect; return the results sorted by score."""
    rest = h.description.without_effect(number)
    rivals = list_rivals(search, h.effects[number], rest.effects)
    starts: list[tuple[Description, Start | None]] = [(rest.add_effects(rival), None) for rival in rivals]
    if scaled := replace_by_gain(search, h, number):
        starts.append((scaled[0], scaled))
    fitted = map_in_parallel(lambda start: search.fit_rival(start[0], h, start[1]), starts)
    return sorted((one for one in fitted if one and one.is_finite), key=lambda one: one.score)


def replace_by_gain(search: Search, h: Hypothesis, number: int) -> Start | None:
    """Return a hypothesis with another position gain in place of an effect; None if its joint has one already.

    All torques of the joint are multiplied by the number at which the effect is no longer needed.
    """
    effect, taken = h.effects[number], h.description
    kinds = {parameter.kind for parameter in search.train.nominal.base if parameter.joint == effect.joint}
    known = [effect_key(other) for other in h.effects]
    if "gain" not in kinds or f"{effect.joint}.gain" in taken.freed or (STIFFNESS, effect.joint) in known:
        return None
    spec = search.train.nominal.spec
    ratio, rest = find_sufficient_ratio(effect, spec), leave_out(taken, h.fit.factors, spec, number)
    if ratio is None or rest is None or STIFFNESS in taken.shared:  # a shared gain belongs to other joints
        return None
    first = find_effect(STIFFNESS).parameters[0]
    gain = make_effect(STIFFNESS, effect.joint, {first.name: min(max(ratio, first.low), first.high)})
    return rest[0].add_effects(gain), rest[1]


def list_rivals(search: Search, effect: Effect, others: Sequence[Effect]) -> list[Effect]:
    """Return the effects that competed with an effect, best first; only one if there are many effects."""
    taken = {effect_key(effect), *map(effect_key, others)}
    result = []
    for rival in search.rivals.get(effect_key(effect), []):
        if effect_key(rival) not in taken:
            taken.add(effect_key(rival))
            result.append(rival)
    if len(others) >= LARGE_SIZE:
        return result[:1]
    return result[: MAX_ALTERNATIVES if effect.in_model else MAX_ALTERNATIVES + MAX_LEADERS]
