"""Final fit to all training episodes, with confidence intervals and diagnostics."""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from nas_data.effects.base import Effect, Parameter
from nas_data.gap.nominal_parameters import FIRM
from nas_data.gap.search.fit import Fit, build_normal_equations, fit, measure_jacobian
from nas_data.gap.search.hypothesis import Description, Key, effect_key, reuse_jacobian
from nas_data.gap.search.intervals import (
    FORM_DEVIATION,
    NORMAL95,
    compute_intervals,
    number_recordings,
)
from nas_data.gap.search.objective import FitTask
from nas_data.gap.search.parameters import FreeParameters
from nas_data.joint_units import convert_hinge_unit

ROUNDS = 2  # most fits, each with the timestep correction computed at the result of the last
SETTLED_CHANGE = 0.02  # largest change of θ, 2 % of a parameter, after which the correction is not computed again
MAX_RATIO = 1.3  # largest ratio of a parameter between two halves of the episodes that agree
BOUND_MARGIN = 1e-6  # distance of log(factor) from a bound that counts as on it


@dataclass(frozen=True)
class FinalFit:
    """A hypothesis fitted to all training episodes.

    Attributes:
        effects: Effects with fitted parameters.
        factors: Factors of the model's parameters, by name.
        intervals: 95 % confidence interval of each parameter, for each effect.
        fine: Whether the fit assumes finer physics steps than the model's own.
        at_bound: Names of the factors on a bound.
        conditioning: Condition number of the normal equations, scaled to a unit diagonal; 1 if nothing was fitted.
        stable: Whether two halves of the episodes agree on a joint's parameters, by joint with effects.
    """

    effects: tuple[Effect, ...]
    factors: Mapping[str, float]
    intervals: tuple[Mapping[str, tuple[float, float]], ...]
    fine: bool = True
    at_bound: frozenset[str] = frozenset()
    conditioning: float = 1.0
    stable: Mapping[str, bool] = field(default_factory=dict)

    def with_values(self, others: Mapping[Key, Effect]) -> "FinalFit":
        """Return only some effects, with the values of other fits, to which their intervals reach."""
        kept = [number for number, effect in enumerate(self.effects) if effect_key(effect) in others]
        effects = tuple(others[effect_key(self.effects[number])] for number in kept)
        intervals = tuple(
            {name: reach(interval, getattr(effect, name)) for name, interval in self.intervals[number].items()}
            for number, effect in zip(kept, effects, strict=True)
        )
        return replace(self, effects=effects, intervals=intervals)


def reach(interval: tuple[float, float], value: float) -> tuple[float, float]:
    """Return an interval extended to a value."""
    return min(interval[0], value), max(interval[1], value)


def fit_final(
    task: FitTask, description: Description, factors: dict[str, float], rounds: int = ROUNDS, intervals: bool = True
) -> FinalFit:
    """Fit a hypothesis to all training episodes.

    Args:
        task: Model and all training episodes.
        description: Hypothesis; its effects are the initial values.
        factors: Initial factors of the model's parameters, by name, and of friction that is made firm.
        rounds: Number of fits, each relinearised at the last.
        intervals: Whether to compute the confidence intervals, which takes up to two further fits.
    """
    firm = {name: factor for name, factor in factors.items() if name.endswith(FIRM)}
    task = task.with_firm_friction(firm) if firm else task
    parameters = description.parameters(task.nominal.base)
    theta = parameters.initial_theta(factors)
    found: Fit | None = None
    for _ in range(rounds):
        task = task.relinearise(parameters, theta)
        known = reuse_jacobian(found, parameters, len(description.effects))
        known |= measure_columns(task, parameters, theta, [c for c in range(parameters.size) if c not in known])
        better = fit(task, parameters, theta, known, steps=3, jacobian_refreshes=0)
        if better is None:
            break
        settled = found is not None or np.abs(better.theta - theta).max(initial=0.0) < SETTLED_CHANGE
        found, theta = better, better.theta
        if settled:
            break
    if found is None:
        return FinalFit(description.effects, factors, tuple({} for _ in description.effects))
    return FinalFit(
        effects=found.effects,
        factors={**found.factors, **firm},
        intervals=compute_intervals(task, description, found) if intervals else tuple({} for _ in found.effects),
        fine=task.fine,
        at_bound=find_at_bound(found),
        conditioning=compute_conditioning(task, found),
        stable=compare_halves(task, found),
    )


def measure_columns(
    task: FitTask, parameters: FreeParameters, theta: np.ndarray, columns: Sequence[int]
) -> dict[int, np.ndarray]:
    """Return columns of the Jacobian by index; empty if the model diverges.

    Args:
        task: Model and episodes.
        parameters: Free parameters.
        theta: Values at which to measure, shape (size,).
        columns: Indices of the columns.
    """
    predicted = task.predict(parameters, theta)
    if predicted is None:
        return {}
    return dict(zip(columns, measure_jacobian(task, parameters, theta, predicted, columns), strict=True))


def compare_halves(task: FitTask, found: Fit) -> dict[str, bool]:
    """Return for each joint with effects whether even and odd episodes agree on the effects' parameters.

    An episode is whole, or a window of one if fewer than four were recorded. Each half takes one Gauss-Newton step from
    the common fit, Δθ = −H⁻¹ g with its own H = Jᵀ W J + prior and gradient g. No rollout is needed. They agree if the
    difference is within 1.96 of its standard deviations and within a factor of 1.3.
    """
    recordings = number_recordings(task.evidence)
    if recordings.max() < 1 or not found.effects:
        return {}
    moved, spread = [], []
    prior = found.parameters.prior_weights(found.theta) ** 2
    for half in (np.flatnonzero(recordings % 2 == parity) for parity in (0, 1)):
        part = task.select(half)
        hessian, gradient = build_normal_equations(part, found.predicted[half], found.jacobian[:, half])
        inverse = np.linalg.pinv(hessian + np.diag(prior) + 1e-9 * np.eye(len(prior)))
        moved.append(-inverse @ (gradient + prior * found.theta))
        spread.append(np.clip(np.diag(inverse), 0, None))
    apart = np.abs(moved[0] - moved[1])
    allowed = np.minimum(NORMAL95 * np.sqrt(spread[0] + spread[1]) + FORM_DEVIATION, math.log(MAX_RATIO))
    agreed: dict[str, bool] = {}
    for column in range(len(found.parameters.effect_parameters)):
        for effect in found.parameters.effects_of(column):
            if (joint := effect.local_joint) is not None:
                agreed[joint] = agreed.get(joint, True) and bool(apart[column] <= allowed[column])
    return agreed


def find_at_bound(found: Fit) -> frozenset[str]:
    """Return the names of the model's parameters that a fit left on a bound."""
    factors = found.factors
    ends = {p.name: p.bounds for p in found.parameters.base}
    return frozenset(
        name
        for name, (low, high) in ends.items()
        if not low + BOUND_MARGIN < math.log(factors[name]) < high - BOUND_MARGIN
    )


def compute_conditioning(task: FitTask, found: Fit) -> float:
    """Return the condition number of the normal equations with prior, scaled to a unit diagonal; at most 1/ε."""
    hessian, _ = build_normal_equations(task, found.predicted, found.jacobian)
    hessian = hessian + np.diag(found.parameters.prior_weights(found.theta) ** 2)
    scale = 1 / np.sqrt(np.maximum(np.diag(hessian), 1e-300))
    number = float(np.linalg.cond(hessian * scale[:, None] * scale[None])) if len(hessian) else 1.0
    return min(number, 1 / float(np.finfo(float).eps))  # larger numbers are rounding, and JSON has no infinity


def list_retuned(final: FinalFit, smallest: float = 0.005) -> list[dict[str, object]]:
    """Return the model's parameters that changed by at least half a percent, as the report lists them."""
    return [
        {"parameter": name, "factor": round(factor, 4), "at_bound": name in final.at_bound}
        for name, factor in final.factors.items()
        if abs(math.log(factor)) > smallest or name.endswith(FIRM)
    ]


def list_parameters(
    effect: Effect,
    interval: Mapping[str, tuple[float, float]],
    episode_range: Mapping[str, tuple[float, float]],
    slides: Collection[str] = (),
) -> dict[str, object]:
    """Return an effect's parameters with units, intervals and ranges over episodes, as the report lists them.

    Args:
        effect: Fitted effect.
        interval: 95 % intervals by parameter.
        episode_range: Smallest and largest value of single episodes, by parameter that differs between them.
        slides: Names of the slides, which have other units.
    """

    def entry(parameter: Parameter) -> dict[str, object]:
        return {
            "value": float(getattr(effect, parameter.name)),
            "unit": convert_hinge_unit(parameter.unit, effect.joint in slides),
            "interval95": interval.get(parameter.name),
            "episode_range": episode_range.get(parameter.name),
        }

    return {parameter.name: entry(parameter) for parameter in effect.free_parameters}
