"""The last fit, on all training episodes, and how sure it makes of every number."""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from nas_data.effects.base import Effect, Parameter
from nas_data.gap.nominal_parameters import TOLERANCE, own_size
from nas_data.gap.search.fit import Fit, fit, measure_jacobian, normal_equations
from nas_data.gap.search.hypothesis import Description, reuse_jacobian
from nas_data.gap.search.objective import FitTask
from nas_data.gap.search.parameters import FreeParameters
from nas_data.joint_units import unit_at

ROUNDS = 2  # fits, each with the correction for finer steps computed where the last one ended
LIKENESS = 0.01  # standard deviation of a parameter between two descriptions of one effect, as a part of it
SAME_SIZE = 1.3  # factor within which two halves must agree on a parameter
ON_BOUND = 1e-6  # of a logarithm
NORMAL95 = 1.96  # standard deviations on each side that hold 95 % of a normal distribution


@dataclass(frozen=True)
class Final:
    """A hypothesis fitted to all training episodes.

    Attributes:
        effects: Effects with fitted parameters.
        factors: Factors of the model's parameters, by name.
        intervals: For each effect, lowest and highest value of each parameter in 95 % of repetitions.
        fine: Whether they stand for finer physics steps than the model's own; as the last fit has it.
        at_bound: Names of the factors that ended on a bound.
        conditioning: Condition number of the fit's normal equations, scaled to a unit diagonal; 1 where nothing was
            fitted.
        stable: Of which joints with effects two halves of the episodes agree on the parameters.
    """

    effects: tuple[Effect, ...]
    factors: Mapping[str, float]
    intervals: tuple[Mapping[str, tuple[float, float]], ...]
    fine: bool = True
    at_bound: frozenset[str] = frozenset()
    conditioning: float = 1.0
    stable: Mapping[str, bool] = field(default_factory=dict)


def finish(task: FitTask, description: Description, factors: dict[str, float], rounds: int = ROUNDS) -> Final:
    """Fit a chosen hypothesis to all training episodes.

    Args:
        task: Model and all training episodes.
        description: What is assumed, its effects where the search left them.
        factors: Factors of the model's parameters likewise.
        rounds: How often.
    """
    parameters = description.parameters(task.nominal.base)
    theta = parameters.start(factors)
    found: Fit | None = None
    for _ in range(rounds):
        task = task.relinearise(parameters, theta)
        known = reuse_jacobian(found, parameters, len(description.effects))
        known |= measure_columns(task, parameters, theta, [c for c in range(parameters.size) if c not in known])
        better = fit(task, parameters, theta, known, steps=3, jacobian_refreshes=0)
        if better is None:
            break
        found, theta = better, better.theta
    if found is None:
        return Final(description.effects, factors, tuple({} for _ in description.effects))
    return Final(
        effects=found.effects,
        factors=found.factors,
        intervals=intervals(task, found),
        fine=task.fine,
        at_bound=at_bound(found),
        conditioning=conditioning(task, found),
        stable=stability(task, found),
    )


def measure_columns(
    task: FitTask, parameters: FreeParameters, theta: np.ndarray, columns: Sequence[int]
) -> dict[int, np.ndarray]:
    """Return columns of the Jacobian at some numbers, by index; none where the model diverges there.

    The search ended near, so that the steps from there need no columns of their own.
    """
    predicted = task.predict(parameters, theta)
    if predicted is None:
        return {}
    return dict(zip(columns, measure_jacobian(task, parameters, theta, predicted, columns), strict=True))


def stability(task: FitTask, found: Fit) -> dict[str, bool]:
    """Return of which joints with effects every other episode and the rest agree on all parameters of the effects.

    Around the fit, each half moves the numbers by Δθ = −H⁻¹ g, with its own H = Jᵀ W J + prior and g; no rollout is
    needed. They agree where the difference is within 1.96 of its standard deviations, and within a factor of 1.3.
    """
    episodes = np.arange(len(task.evidence))
    if len(episodes) < 2 or not found.effects:
        return {}
    moved, spread = [], []
    prior = found.parameters.prior(found.theta) ** 2
    for half in (episodes[::2], episodes[1::2]):
        part = task.select(half)
        square, pull = normal_equations(part, found.predicted[half], found.jacobian[:, half])
        inverse = np.linalg.pinv(square + np.diag(prior) + 1e-9 * np.eye(len(prior)))
        moved.append(-inverse @ (pull + prior * found.theta))
        spread.append(np.clip(np.diag(inverse), 0, None))
    apart = np.abs(moved[0] - moved[1])
    allowed = np.minimum(NORMAL95 * np.sqrt(spread[0] + spread[1]) + LIKENESS, math.log(SAME_SIZE))
    agreed: dict[str, bool] = {}
    for column in range(len(found.parameters.of_effects)):
        for effect in found.parameters.parameters_of(column):
            if effect.joint is not None:
                agreed[effect.joint] = agreed.get(effect.joint, True) and bool(apart[column] <= allowed[column])
    return agreed


def at_bound(found: Fit) -> frozenset[str]:
    """Return the names of the model's parameters that a fit left on a bound."""
    factors = found.factors
    ends = {p.name: p.bounds for p in found.parameters.base}
    return frozenset(
        name for name, (low, high) in ends.items() if not low + ON_BOUND < math.log(factors[name]) < high - ON_BOUND
    )


def conditioning(task: FitTask, found: Fit) -> float:
    """Return the condition number of the normal equations, prior included, scaled to a unit diagonal."""
    square, _ = normal_equations(task, found.predicted, found.jacobian)
    square = square + np.diag(found.parameters.prior(found.theta) ** 2)
    scale = 1 / np.sqrt(np.maximum(np.diag(square), 1e-300))
    return float(np.linalg.cond(square * scale[:, None] * scale[None])) if len(square) else 1.0


def intervals(task: FitTask, found: Fit) -> tuple[Mapping[str, tuple[float, float]], ...]:
    """Return the 95 % intervals of the effects' parameters.

    Three doubts are added: the curvature of the loss, with the base free; how differently single episodes pull, which
    holds whatever the errors look like (White, 1982); and how much two descriptions of one effect differ. What an
    effect adds to something that the model has (damping, say) is known no better than the model's own part of it.
    """
    spread = np.hypot(*deviations(task, found))
    result: list[dict[str, tuple[float, float]]] = [{} for _ in found.effects]
    for free, number, width in zip(found.parameters.of_effects, found.theta, spread, strict=False):
        likeness = LIKENESS * abs(float(number) if free.signed else 1.0)
        reach = NORMAL95 * float(np.hypot(width, likeness))
        for place in free.places:
            doubt = NORMAL95 * TOLERANCE * in_common(task, found.effects[place], free.parameter)
            ends = [free.value(float(number) + sign * reach) + sign * doubt for sign in (-1, 1)]
            result[place][free.parameter.name] = (min(ends), max(ends))
    return tuple(result)


def deviations(task: FitTask, found: Fit) -> tuple[np.ndarray, np.ndarray]:
    """Return the standard deviations of the numbers by the loss's curvature and by the episodes' pulls, (size,) each.

    Errors of a rollout are alike for a while (`CORRELATION`); in the curvature, so many rows count as one.
    """
    size, episodes = len(found.jacobian), len(task.evidence)
    weights = task.weights(found.predicted) * task.evidence.mask[..., None]
    rows = (found.jacobian * weights).reshape(size, episodes, -1)
    flat = rows.reshape(size, -1)
    inverse = np.linalg.inv(flat @ flat.T + np.diag(found.parameters.prior(found.theta) ** 2) + 1e-9 * np.eye(size))
    errors = (task.evidence.errors(found.predicted) * weights).reshape(episodes, -1)
    pulls = inverse @ np.einsum("pet,et->pe", rows, errors)
    by_episode = np.sqrt((pulls**2).sum(1) * episodes / max(1, episodes - 1))
    return np.sqrt(np.clip(np.diag(inverse), 0.0, None)), by_episode


def in_common(task: FitTask, effect: Effect, parameter: Parameter) -> float:
    """Return how much of what an effect's first parameter adds to the model has already, in its unit."""
    if not effect.replaces or effect.joint is None or parameter is not effect.parameters[0]:
        return 0.0
    return own_size(task.nominal.spec, effect.joint, effect.replaces)


def list_retuned(final: Final, smallest: float = 0.005) -> list[dict[str, object]]:
    """Return the parameters of the model that were changed by half a percent or more, as the report lists them."""
    return [
        {"parameter": name, "factor": round(factor, 4), "at_bound": name in final.at_bound}
        for name, factor in final.factors.items()
        if abs(math.log(factor)) > smallest
    ]


def values(
    effect: Effect, interval: Mapping[str, tuple[float, float]], slides: Collection[str] = ()
) -> dict[str, object]:
    """Return an effect's parameters with units and intervals, as the report lists them; `slides` decides the units."""

    def entry(parameter: Parameter) -> dict[str, object]:
        value = float(getattr(effect, parameter.name))
        low, high = interval.get(parameter.name, (value, value))
        return {"value": value, "unit": unit_at(parameter.unit, effect.joint in slides), "interval95": [low, high]}

    return {parameter.name: entry(parameter) for parameter in effect.free_parameters}
