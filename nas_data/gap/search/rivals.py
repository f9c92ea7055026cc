"""Rivals of the effects that are kept: each may still prove better, or as good and easier to write down."""

from collections.abc import Sequence

from nas_data.effects.base import Effect
from nas_data.gap.search.hypothesis import Hypothesis, place
from nas_data.gap.search.state import Search
from nas_data.gap.side_by_side import side_by_side

RIVALS = 3  # that are fitted beside the other effects, for each effect
BETTER = 4.0  # nats by which a rival must be ahead of what is kept
FACED = 2  # effects that one must face, of those that it is easily confused with and that a hook tells apart from it
SPARE = 2.0  # nats that a rival's every further parameter must bring besides


def outdone(search: Search, kept: Hypothesis, rounds: int = 3) -> Hypothesis:
    """Replace effects by rivals that do better beside all the others.

    Rivals were beaten when less was known. Where one that a model file can express does no worse than one that only a
    hook can, it is taken: friction under load, say, and a lower torque limit are nearly the same where nothing is
    lifted and every move saturates the servo.
    """
    for number, effect in enumerate(kept.effects if rounds else ()):
        others = beside(kept, number)
        for found in fitted_rivals(search, kept, number):
            if found.loss < kept.loss - lead(effect, found.effects[-1]):
                search.report(f"{effect.name()} outdone", found)
                search.rivals[place(found.effects[-1])] = [effect, *contenders(search, effect, others)]
                return outdone(search, search.continued(found), rounds - 1)
    return kept


def confronted(search: Search, kept: Hypothesis) -> None:
    """Let effects of a model file face those that only a hook can express, where they are easily confused.

    Which of them is tried first depends on what else had been named by then, and later they may be no rivals any more.
    """
    for number, effect in enumerate(kept.effects):
        if effect.joint is None:
            continue
        without = search.without(kept, number) or search.null
        found, _ = search.screened(without.fit, kept, {effect.joint})
        known = search.rivals.setdefault(place(effect), [])
        met = {place(rival) for rival in known}
        others = [c.effect for c in found if c.effect.joint and c.effect.in_model != effect.in_model]
        known[:0] = [other for other in others if confusable(effect, other) and place(other) not in met][:FACED]


def confusable(effect: Effect, other: Effect) -> bool:
    """Return whether either of two effects is said to be easily confused with the other."""
    return other.name() in effect.confused_with or effect.name() in other.confused_with


def lead(effect: Effect, rival: Effect) -> float:
    """Return by how many nats a rival must be ahead of an effect to take its place."""
    if rival.in_model and not effect.in_model:
        return 0.0
    return BETTER + SPARE * max(0, len(rival.sought) - len(effect.sought))


def fitted_rivals(search: Search, kept: Hypothesis, number: int) -> list[Hypothesis]:
    """Return what is kept with each rival of one effect in its place, fitted, the best first."""
    others = beside(kept, number)
    rivals = contenders(search, kept.effects[number], others)
    fitted = side_by_side(lambda rival: search.rival((*others, rival), kept), rivals)
    return sorted((h for h in fitted if h and h.is_sound), key=lambda h: h.loss)


def beside(kept: Hypothesis, number: int) -> tuple[Effect, ...]:
    """Return the effects that are kept beside one."""
    return tuple(effect for index, effect in enumerate(kept.effects) if index != number)


def contenders(search: Search, effect: Effect, others: Sequence[Effect]) -> list[Effect]:
    """Return what competed with an effect when it was added, the best first, each place once."""
    taken = {place(effect), *map(place, others)}
    result = []
    for rival in search.rivals.get(place(effect), []):
        if place(rival) not in taken:
            taken.add(place(rival))
            result.append(rival)
    return result[: RIVALS if effect.in_model else RIVALS + FACED]
