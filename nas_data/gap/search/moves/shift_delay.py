"""Shift delays by whole physics steps, because their loss has a local minimum at each."""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

from nas_data.effects.base import Effect, make_effect
from nas_data.gap.search.constants import MAX_ROUNDS, PRICE
from nas_data.gap.search.fit import Fit, fit
from nas_data.gap.search.hypothesis import Hypothesis, reuse_jacobian
from nas_data.gap.search.objective import FitTask
from nas_data.gap.search.parameters import FreeParameters
from nas_data.gap.search.search import Search
from nas_data.gap.side_by_side import map_in_parallel

SHIFTS = (-3, -2, -1, 1, 2, 3)  # of the model's own physics steps, either way


def apply(search: Search, h: Hypothesis) -> Hypothesis:
    """Return a hypothesis with delays shifted by physics steps, if the score falls.

    A simulated arm applies a command at one of its physics steps. A delay between two steps mixes two commands, which
    no such recording does. The loss therefore has a local minimum at every step, and gradients do not lead to the next.
    All parameters are fitted again after each shift, because they depend on the delay.

    Args:
        search: Search; it continues with the model's own physics steps if a shift helps.
        h: Hypothesis; returned unchanged if it has no delay or every joint is explained.
    """
    timestep = float(search.train.nominal.spec.option.timestep)
    if search.floor_ratios(h).max() <= search.at_floor or not list(generate_shifts(h.effects, timestep)):
        return h
    now = search.task.reestimate(h.fit.parameters, h.fit.theta)
    own = replace(now, fine=False).reestimate(h.fit.parameters, h.fit.theta).with_own_timestep().with_tolerance_of(now)
    found = shift_repeatedly(own, h.fit, timestep)
    reached = fit(now, h.fit.parameters, h.fit.theta, dict(enumerate(h.fit.jacobian)), steps=0)
    if found is None or reached is None or found.loss > reached.loss + -PRICE:
        return h
    search.task = own
    there = search.update_objective(h.description, found)
    search.report("  delay shifted", there)
    return there


def shift_repeatedly(task: FitTask, near: Fit, timestep: float) -> Fit | None:
    """Return the best fit over repeated shifts; None if none helps or the model diverges."""
    best = before = fit_briefly(task, near, near.effects)
    for _ in range(MAX_ROUNDS):
        if best is None:
            return None
        tried = map_in_parallel(partial(fit_briefly, task, best), list(generate_shifts(best.effects, timestep)))
        found = min(filter(None, tried), key=lambda one: one.loss, default=best)
        if found.loss < best.loss:  # parameters fitted to the other delay need more steps
            found = fit(task, found.parameters, found.theta, steps=5, jacobian_refreshes=1) or found
        if found.loss > best.loss + -PRICE:
            break
        best = found
    return None if best is before else best


def fit_briefly(task: FitTask, near: Fit, effects: tuple[Effect, ...]) -> Fit | None:
    """Fit effects for a few steps from another fit, with its Jacobian except for the columns of delays."""
    parameters = FreeParameters(effects, near.parameters.base, near.parameters.shared)
    known = reuse_jacobian(near, parameters)
    for index, free in enumerate(parameters.effect_parameters):
        if free.parameter.name in effects[free.effect_indices[0]].stepwise:
            known.pop(index, None)
    return fit(task, parameters, parameters.initial_theta(near.factors), known, steps=3, jacobian_refreshes=0)


def generate_shifts(effects: tuple[Effect, ...], timestep: float) -> Iterator[tuple[Effect, ...]]:
    """Yield the effects with one stepwise parameter shifted by some physics steps of `timestep` [s]."""
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
