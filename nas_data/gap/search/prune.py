"""Leave out what the data do not need: effects that help too little, parameters to spare, names that explain little."""

from collections.abc import Container, Sequence
from functools import partial

import numpy as np

from nas_data.effects.base import Effect, find_effect, make_effect
from nas_data.gap.search.grow import NOTICEABLE
from nas_data.gap.search.hypothesis import MANY, Hypothesis, place, relieves, worth
from nas_data.gap.search.state import Search
from nas_data.gap.side_by_side import side_by_side

SIMPLER = 2  # effects of fewer parameters that are tried in the place of one
BETTER = 0.90  # held-out error of the most improved joint, with over without the effect
WINS = 0.75  # share of held-out episodes in which the effect must help, of those that it changes
SAME = 0.02  # logarithm of an error's ratio up to which an episode counts as not changed
RARE = 1.0  # by which their sum must be below zero where an effect changes less than half of the episodes
POOR = 3.0  # noise floors of rest above which a joint may be called unexplained
UNEXPLAINED = 0.75  # part of a joint's error that must stay, for it to be called so


def pruned(search: Search, kept: Hypothesis) -> Hypothesis:
    """Leave out every effect that held-out episodes do not need, the least needed first."""
    doubted: Sequence[int] = range(len(kept.effects))
    while kept.effects:
        rests = zip(doubted, side_by_side(partial(search.without, kept), doubted), strict=True)
        spare = {number: rest for number, rest in rests if rest is not None and not needs(search, rest, kept)}
        if not spare:
            return kept
        least = min(spare, key=lambda number: spare[number].loss)
        doubted = doubted_again(kept.effects, least, spare)
        kept = spare[least]
        search.report("dropped to", kept)
    return kept


def doubted_again(effects: Sequence[Effect], gone: int, spare: Container[int]) -> list[int]:
    """Return the numbers, in what is left, of the effects that may be spared once one of them is gone.

    All, unless they are many: then those that could be spared before, and those that the one gone shared a joint with.
    """
    joint = effects[gone].joint
    few = len(effects) <= MANY or joint is None
    left = [number for number in range(len(effects)) if number != gone]
    near = [number for number in left if few or number in spare or effects[number].joint in (joint, None)]
    return [number - (number > gone) for number in near]


def needs(search: Search, without: Hypothesis, with_: Hypothesis) -> bool:
    """Whether an effect is worth its name: on held-out episodes, or for a base that it leaves as it should be."""
    logs = search.logs(without, with_)
    best = int(logs.mean(0).argmin())
    better = np.exp(logs.mean(0)[best]) <= BETTER and often(logs[:, best])
    return bool(better or (logs.sum() < 0 and relieves(without, with_)))


def often(logs: np.ndarray) -> bool:
    """Whether an effect helps in most of the episodes that it changes, by the logs of their error's ratio (E,).

    A limit that is reached in few of them changes nothing in the others; it must then help a lot.
    """
    told = logs[np.abs(logs) > SAME]
    lost = int((told > 0).sum())
    if len(told) < len(logs) / 2:
        return lost <= (1 - WINS) * len(told) and logs.sum() < -RARE
    return lost <= max((1 - WINS) * len(logs), min(1, len(logs) - 1))  # one may always be lost, but not the only one


def simplified(search: Search, kept: Hypothesis) -> Hypothesis:
    """Put an effect of fewer parameters in the place of each that needs its more of them hardly at all."""
    for number, effect in enumerate(kept.effects):
        simpler = [find_effect(name) for name in effect.confused_with]
        names = {kind.name() for kind in simpler if len(kind.parameters) < len(effect.parameters)}
        if not names or effect.joint is None:
            continue
        fitted = [*absorbed(search, kept, effect, names), *replaced(search, kept, number, names)]
        for other in sorted(fitted, key=worth):
            if np.exp(search.logs(other, kept).mean(0).min()) > NOTICEABLE:
                search.rivals.setdefault(place(other.effects[-1]), []).append(effect)
                search.report(f"{effect.name()} simplified", other)
                return simplified(search, other)
    return kept


def absorbed(search: Search, kept: Hypothesis, effect: Effect, names: Container[str]) -> list[Hypothesis]:
    """Return what is left of a hypothesis when a special case of an effect takes its size over, and its own besides.

    Two kinds of friction share one torque in any way, and left alone with its part the simpler one never gets to the
    whole. All else begins where it was: what an effect hides is rarely found from where nothing hides it.
    """
    fitted = []
    for kind in (find_effect(name) for name in effect.confused_with if name in names):
        if all(parameter in effect.parameters for parameter in kind.parameters):
            both = (place(effect), (kind.name(), effect.joint))
            sizes = {p.name: sum(getattr(e, p.name) for e in kept.effects if place(e) in both) for p in kind.parameters}
            others = [e for e in kept.effects if place(e) not in both]
            whole = make_effect(kind.name(), effect.joint, sizes)
            fitted.append(search.fitted((*others, whole), kept.fit.factors, renewals=1))
    return [h for h in fitted if h]


def replaced(search: Search, kept: Hypothesis, number: int, names: Container[str]) -> list[Hypothesis]:
    """Return the hypotheses with one of some simpler effects in the place of an effect, those that promise most."""
    joint, rest = kept.effects[number].joint, search.without(kept, number)
    if rest is None or joint is None:
        return []
    found, _ = search.screened(rest.fit, rest, {joint})
    chosen = [c for c in found if c.effect.name() in names and c.effect.joint == joint][:SIMPLER]
    fitted = [search.fitted((*rest.effects, c.effect), c.factors, rest.fit, renewals=1) for c in chosen]
    return [h for h in fitted if h]


def adequate(search: Search, kept: Hypothesis) -> Hypothesis:
    """Take back the names in joints of which most stays unexplained: their cause is not in the catalogue."""
    rest, null = search.ratio(kept), search.ratio(search.judged(search.null.fit))
    joints = zip(search.train.nominal.joints, rest, null, strict=True)
    unknown = {joint for joint, left, before in joints if left > POOR and left > UNEXPLAINED * before}
    sound = tuple(effect for effect in kept.effects if effect.joint not in unknown)
    if len(sound) == len(kept.effects):
        return kept
    other = search.fitted(sound, kept.fit.factors, kept.fit, steps=4) if sound else search.judged(search.null.fit)
    if other is None:
        return kept
    search.report(f"{', '.join(sorted(unknown))} not explained by any effect", other)
    return other
