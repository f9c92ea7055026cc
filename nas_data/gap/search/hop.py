"""Hop from one physics step to another: a delay fits best where it is a whole number of them, and a fit stays there."""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

from nas_data.effects.base import Effect, make_effect
from nas_data.gap.search.fit import Fit, Task, fit, loss
from nas_data.gap.search.grow import AT_FLOOR
from nas_data.gap.search.hypothesis import GAIN, Hypothesis, lent_slopes
from nas_data.gap.search.state import Search
from nas_data.gap.search.unknowns import Unknowns
from nas_data.gap.side_by_side import side_by_side

HOPS = (-3, -2, -1, 1, 2, 3)  # of the model's own physics steps, either way
ROUNDS = 3  # at most


def hopped(search: Search, h: Hypothesis) -> Hypothesis:
    """Return a hypothesis with its delays some physics steps longer or shorter, where that explains more.

    What a simulated arm is told takes effect at one of its physics steps. A delay between two of them mixes what is
    told before and after, which no such recording does, so that the loss has a dip at every step, and no slope leads
    from one to the next. The base bends to the wrong one, so that it is fitted anew after each hop.

    Args:
        search: Search; goes on with the model's own physics steps where a hop helps.
        h: Hypothesis; as it is where it has no delay, or every joint is explained.
    """
    timestep = float(search.train.nominal.spec.option.timestep)
    if search.ratio(h).max() <= AT_FLOOR or not list(hops(h.effects, timestep)):
        return h
    unknowns, numbers = h.fit.unknowns, h.fit.numbers
    now = search.sub.focused(unknowns, numbers)
    own = replace(replace(now, fine=False).focused(unknowns, numbers), coarseness=now.coarseness)
    found = walked(own, h.fit, timestep)
    if found is None or found.loss > loss(now, unknowns, numbers) - GAIN:
        return h
    search.sub, search.held = own, replace(search.held, fine=False)
    there = search.refined(search.judged(found))
    search.report("  hopped", there)
    return there


def walked(task: Task, near: Fit, timestep: float) -> Fit | None:
    """Return the best fit that hops lead to, one after the other; None where none helps, or the model diverges."""
    best = before = fitted_on(task, near, near.effects)
    for _ in range(ROUNDS):
        if best is None:
            return None
        tried = side_by_side(partial(fitted_on, task, best), list(hops(best.effects, timestep)))
        found = min(filter(None, tried), key=lambda one: one.loss, default=best)
        if found.loss < best.loss:  # what bent to the other delay takes more than a short fit to straighten
            found = fit(task, found.unknowns, found.numbers, steps=5, renewals=1) or found
        if found.loss > best.loss - GAIN:
            break
        best = found
    return None if best is before else best


def fitted_on(task: Task, near: Fit, effects: tuple[Effect, ...]) -> Fit | None:
    """Return a short fit of effects from where another fit ended, with its slopes but those of what hops."""
    unknowns = Unknowns(effects, near.unknowns.base)
    lent = lent_slopes(near, unknowns)
    for index, unknown in enumerate(unknowns.sought):
        if unknown.parameter.name in effects[unknown.place].stepwise:
            lent.pop(index, None)
    return fit(task, unknowns, unknowns.start(near.factors), lent, steps=3, renewals=0)


def hops(effects: tuple[Effect, ...], timestep: float) -> Iterator[tuple[Effect, ...]]:
    """Yield effects of which one has one parameter another number of physics steps [s] away."""
    for place, effect in enumerate(effects):
        for parameter in effect.sought:
            if parameter.name not in effect.stepwise:
                continue
            own = {each.name: float(getattr(effect, each.name)) for each in effect.parameters}
            at = round(own[parameter.name] / timestep)
            for value in (timestep * (at + count) for count in HOPS):
                if max(parameter.low, timestep) <= value <= parameter.high:
                    moved = make_effect(effect.name(), effect.joint, own | {parameter.name: value})
                    yield (*effects[:place], moved, *effects[place + 1 :])
