"""Shift a delay by whole physics steps: it fits best where it is a whole number of them, and a fit stays there."""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

from nas_data.effects.base import Effect, make_effect
from nas_data.gap.search.fit import Fit, fit
from nas_data.gap.search.hypothesis import PRICE, Hypothesis, reuse_jacobian
from nas_data.gap.search.objective import FitTask
from nas_data.gap.search.parameters import FreeParameters
from nas_data.gap.search.search import AT_FLOOR, ROUNDS, Search
from nas_data.gap.side_by_side import side_by_side

SHIFTS = (-3, -2, -1, 1, 2, 3)  # of the model's own physics steps, either way


def apply(search: Search, h: Hypothesis) -> Hypothesis:
    """Return a hypothesis with its delays some physics steps longer or shorter, where that explains more.

    What a simulated arm is told takes effect at one of its physics steps. A delay between two of them mixes what is
    told before and after, which no such recording does, so that the loss has a dip at every step, and no slope leads
    from one to the next. All else bends to the wrong one, so that it is fitted anew after each shift.

    Args:
        search: Search; goes on with the model's own physics steps where a shift helps.
        h: Hypothesis; as it is where it has no delay, or every joint is explained.
    """
    timestep = float(search.train.nominal.spec.option.timestep)
    if search.ratio(h).max() <= AT_FLOOR or not list(shifts(h.effects, timestep)):
        return h
    now = search.sub.restart(h.fit.parameters, h.fit.theta)
    own = replace(now, fine=False).restart(h.fit.parameters, h.fit.theta).at_own_steps().at_tolerance_of(now)
    found = walk(own, h.fit, timestep)
    reached = fit(now, h.fit.parameters, h.fit.theta, dict(enumerate(h.fit.jacobian)), steps=0)
    if found is None or reached is None or found.loss > reached.loss + -PRICE:
        return h
    search.sub = own
    there = search.settle(h.description, found)
    search.report("  delay shifted", there)
    return there


def walk(task: FitTask, near: Fit, timestep: float) -> Fit | None:
    """Return the best fit that shifts lead to, one after the other; None where none helps, or the model diverges."""
    best = before = fit_briefly(task, near, near.effects)
    for _ in range(ROUNDS):
        if best is None:
            return None
        tried = side_by_side(partial(fit_briefly, task, best), list(shifts(best.effects, timestep)))
        found = min(filter(None, tried), key=lambda one: one.loss, default=best)
        if found.loss < best.loss:  # what bent to the other delay takes more than a short fit to straighten
            found = fit(task, found.parameters, found.theta, steps=5, jacobian_refreshes=1) or found
        if found.loss > best.loss + -PRICE:
            break
        best = found
    return None if best is before else best


def fit_briefly(task: FitTask, near: Fit, effects: tuple[Effect, ...]) -> Fit | None:
    """Return a short fit of effects from where another fit ended, with its Jacobian but for what is shifted."""
    parameters = FreeParameters(effects, near.parameters.base, near.parameters.shared)
    known = reuse_jacobian(near, parameters)
    for index, free in enumerate(parameters.of_effects):
        if free.parameter.name in effects[free.places[0]].stepwise:
            known.pop(index, None)
    return fit(task, parameters, parameters.start(near.factors), known, steps=3, jacobian_refreshes=0)


def shifts(effects: tuple[Effect, ...], timestep: float) -> Iterator[tuple[Effect, ...]]:
    """Yield effects of which one has one parameter another number of physics steps [s] away."""
    for place, effect in enumerate(effects):
        for parameter in effect.free_parameters:
            if parameter.name not in effect.stepwise:
                continue
            own = {each.name: float(getattr(effect, each.name)) for each in effect.parameters}
            at = round(own[parameter.name] / timestep)
            for value in (timestep * (at + count) for count in SHIFTS):
                if max(parameter.low, timestep) <= value <= parameter.high:
                    moved = make_effect(effect.name(), effect.joint, own | {parameter.name: value})
                    yield (*effects[:place], moved, *effects[place + 1 :])
