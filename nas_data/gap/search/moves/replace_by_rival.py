"""Replace effects by rivals that do better beside all the others: they were beaten when less was known."""

from collections.abc import Sequence

from nas_data import registry
from nas_data.effects.base import Effect, find_effect
from nas_data.gap.search.hypothesis import Hypothesis, key
from nas_data.gap.search.moves.drop import MANY, estimate_losses
from nas_data.gap.search.search import FAR_BEHIND, ROUNDS, TRIED, Search
from nas_data.gap.side_by_side import side_by_side

FACED = 2  # effects that one must face, of those that it is easily confused with and that a hook tells apart from it


def apply(search: Search, h: Hypothesis) -> Hypothesis:
    """Let effects face their rivals, those of a model file also those that only a hook can express.

    A single effect that left every other candidate far behind has faced them: nothing else is known since.
    """
    if len(h.effects) == 1 and frozenset(map(key, h.effects)) in search.clear:
        return h
    numbers = doubted(search, h)
    search.say(f"  letting {len(numbers)} of {len(h.effects)} effects face rivals")
    add_rivals(search, h, numbers)
    for _ in range(ROUNDS):
        found = find_better_rival(search, h, doubted(search, h))
        if found is None:
            return h
        h = search.continued(found)
    return h


def doubted(search: Search, h: Hypothesis) -> list[int]:
    """Return the numbers of the effects that face rivals: all, or where there are many, those that are needed least."""
    if len(h.effects) <= MANY:
        return list(range(len(h.effects)))
    losses = estimate_losses(search, h)
    return sorted(range(len(h.effects)), key=lambda number: losses[h.effects[number]])[:TRIED]


def find_better_rival(search: Search, h: Hypothesis, numbers: Sequence[int]) -> Hypothesis | None:
    """Return the first hypothesis with a rival in the place of an effect that has a better score; None without one."""
    for number in numbers:
        effect = h.effects[number]
        for found in fitted_rivals(search, h, number):
            if found.score < h.score:
                search.report(f"{effect.name()} replaced", found)
                others = [other for other in h.effects if other is not effect]
                search.rivals[key(found.effects[-1])] = [effect, *contenders(search, effect, others)]
                return found
    return None


def add_rivals(search: Search, h: Hypothesis, numbers: Sequence[int]) -> None:
    """Let effects face rivals: those that promise most in its place, and those that it is easily confused with.

    An effect of a model file faces those that only a hook can express, and the other way round. Which of them was tried
    first depends on what else had been named by then.
    """
    for number in numbers:
        effect = h.effects[number]
        if effect.joint is None or effect.name() in h.description.shared:
            continue
        known = search.rivals.setdefault(key(effect), [])
        faces_hook = any(confusable(effect, other) for other in hooked_kinds(effect))
        if len(known) >= TRIED and not faces_hook:
            continue
        without = search.without(h, number) or search.null
        found, reach = search.screened(without.fit, h, {effect.joint})
        met = {key(effect), *map(key, known)}
        near = [c for c in found if c.effect.joint and c.loss.over(reach) < FAR_BEHIND]
        others = [c.effect for c in near if key(c.effect) not in met]
        known.extend(others[: TRIED - len(known)])
        hooked = [other for other in others if other.in_model != effect.in_model and confusable(effect, other)]
        known[:0] = [other for other in hooked if other not in known][:FACED]


def hooked_kinds(effect: Effect) -> list[type[Effect]]:
    """Return the kinds of effects that need a hook where one does not, and the other way round."""
    kinds = [find_effect(name) for name in registry.names("effects")]
    return [kind for kind in kinds if kind.in_model != effect.in_model]


def confusable(effect: Effect, other: Effect | type[Effect]) -> bool:
    """Return whether either of two effects is said to be easily confused with the other."""
    return other.name() in effect.confused_with or effect.name() in other.confused_with


def fitted_rivals(search: Search, h: Hypothesis, number: int) -> list[Hypothesis]:
    """Return what is kept with each rival of one effect in its place, fitted, the best first."""
    rest = h.description.without(number)
    rivals = contenders(search, h.effects[number], rest.effects)
    fitted = side_by_side(lambda rival: search.rival(rest.adding(rival), h), rivals)
    return sorted((one for one in fitted if one and one.is_sound), key=lambda one: one.score)


def contenders(search: Search, effect: Effect, others: Sequence[Effect]) -> list[Effect]:
    """Return what competed with an effect when it was added, the best first, each place once; of many effects one."""
    taken = {key(effect), *map(key, others)}
    result = []
    for rival in search.rivals.get(key(effect), []):
        if key(rival) not in taken:
            taken.add(key(rival))
            result.append(rival)
    if len(others) >= MANY:
        return result[:1]
    return result[: TRIED if effect.in_model else TRIED + FACED]
