"""The last fit, on all training episodes, and how sure it makes of every number."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from nas_data.effects.base import Effect, Parameter
from nas_data.gap.base import TOLERANCE, own_size
from nas_data.gap.search.fit import Fit, Task, fit
from nas_data.gap.search.hypothesis import lent_slopes
from nas_data.gap.search.steps import stepped
from nas_data.gap.search.unknowns import Unknowns, free_base

ROUNDS = 2  # fits, each with the correction for finer steps computed where the last one ended
LIKENESS = 0.01  # standard deviation of a parameter between two descriptions of one effect, as a part of it
NORMAL95 = 1.96  # standard deviations on each side that hold 95 % of a normal distribution


@dataclass(frozen=True)
class Final:
    """A hypothesis fitted to all training episodes.

    Attributes:
        effects: Effects with fitted parameters.
        factors: Factors of the base parameters, by name.
        intervals: For each effect, lowest and highest value of each parameter in 95 % of repetitions.
        fine: Whether they stand for finer physics steps than the model's own; as the last fit has it.
        loss: Misfit and prior on all training episodes; infinite where nothing was fitted.
    """

    effects: tuple[Effect, ...]
    factors: Mapping[str, float]
    intervals: tuple[Mapping[str, tuple[float, float]], ...]
    fine: bool = True
    loss: float = math.inf


def finish(task: Task, effects: Sequence[Effect], factors: dict[str, float], rounds: int = ROUNDS) -> Final:
    """Fit a chosen hypothesis to all training episodes.

    Args:
        task: Model and all training episodes.
        effects: Effects where the search left them.
        factors: Base factors likewise.
        rounds: How often.
    """
    unknowns = Unknowns(tuple(effects), free_base(task.nominal.base, effects))
    numbers = unknowns.start(factors)
    found: Fit | None = None
    for _ in range(rounds):
        task = task.focused(unknowns, numbers)
        better = fit(task, unknowns, numbers, lent_slopes(found, unknowns, len(unknowns.effects)), steps=3, renewals=0)
        if better is None:
            break
        found, numbers = better, better.numbers
    if found is None:
        return Final(tuple(effects), factors, tuple({} for _ in effects))
    task, found = stepped(task, found)
    return Final(found.effects, found.factors, intervals(task, found), task.fine, found.loss)


def intervals(task: Task, found: Fit) -> tuple[Mapping[str, tuple[float, float]], ...]:
    """Return the 95 % intervals of the effects' parameters.

    Three doubts are added: the curvature of the loss, with the base free; how differently single episodes pull, which
    holds whatever the errors look like (White, 1982); and how much two descriptions of one effect differ. What an
    effect adds to something that the model has (damping, say) is known no better than the model's own part of it.
    """
    spread = np.hypot(*deviations(task, found))
    result: list[dict[str, tuple[float, float]]] = [{} for _ in found.effects]
    for unknown, number, width in zip(found.unknowns.sought, found.numbers, spread, strict=False):
        effect = found.effects[unknown.place]
        likeness = LIKENESS * abs(float(number) if unknown.signed else 1.0)
        reach = NORMAL95 * float(np.hypot(width, likeness))
        doubt = NORMAL95 * TOLERANCE * shared(task, effect, unknown.parameter)
        ends = [unknown.value(float(number) + sign * reach) + sign * doubt for sign in (-1, 1)]
        result[unknown.place][unknown.parameter.name] = (min(ends), max(ends))
    return tuple(result)


def deviations(task: Task, found: Fit) -> tuple[np.ndarray, np.ndarray]:
    """Return the standard deviations of the numbers by the loss's curvature and by the episodes' pulls, (size,) each.

    Errors of a rollout are alike for a while (`CORRELATION`); in the curvature, so many rows count as one.
    """
    size, episodes = len(found.slopes), len(task.evidence)
    weights = task.weights(found.predicted) * task.evidence.counts[..., None]
    rows = (found.slopes * weights).reshape(size, episodes, -1)
    flat = rows.reshape(size, -1)
    inverse = np.linalg.inv(flat @ flat.T + np.diag(found.unknowns.prior(found.numbers) ** 2) + 1e-9 * np.eye(size))
    errors = (task.evidence.errors(found.predicted) * weights).reshape(episodes, -1)
    pulls = inverse @ np.einsum("pet,et->pe", rows, errors)
    by_episode = np.sqrt((pulls**2).sum(1) * episodes / max(1, episodes - 1))
    return np.sqrt(np.clip(np.diag(inverse), 0.0, None)), by_episode


def shared(task: Task, effect: Effect, parameter: Parameter) -> float:
    """Return how much of what an effect's first parameter adds to the model has already, in its unit."""
    if not effect.replaces or effect.joint is None or parameter is not effect.parameters[0]:
        return 0.0
    return own_size(task.nominal.spec, effect.joint, effect.replaces)


def retuned(factors: Mapping[str, float], smallest: float = 0.005) -> list[dict[str, object]]:
    """Return the base parameters that were changed by half a percent or more, as the report lists them."""
    return [
        {"parameter": name, "factor": round(factor, 4)}
        for name, factor in factors.items()
        if abs(math.log(factor)) > smallest
    ]


def values(effect: Effect, interval: Mapping[str, tuple[float, float]]) -> dict[str, object]:
    """Return an effect's parameters with units and intervals, as the report lists them."""

    def entry(parameter: Parameter) -> dict[str, object]:
        value = float(getattr(effect, parameter.name))
        low, high = interval.get(parameter.name, (value, value))
        return {"value": value, "unit": parameter.unit, "interval95": [low, high]}

    return {parameter.name: entry(parameter) for parameter in effect.sought}
