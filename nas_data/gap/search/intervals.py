"""Confidence intervals of the effects' parameters."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.special import stdtrit

from nas_data.effects.base import Effect, Parameter
from nas_data.gap.episode_batch import EpisodeBatch
from nas_data.gap.floor import compute_floor_ratios
from nas_data.gap.nominal_parameters import TOLERANCE, read_own_amount
from nas_data.gap.search.constants import PARAMETER_PRICE
from nas_data.gap.search.fit import Fit, compute_inverse_hessian, fit
from nas_data.gap.search.hypothesis import Description, reuse_jacobian
from nas_data.gap.search.objective import FitTask
from nas_data.gap.search.scales import estimate_scales

FORM_DEVIATION = 0.01  # relative standard deviation between two formulations of one effect
FEWEST_RECORDINGS = 4  # recorded episodes below which windows of them are compared
NORMAL95 = 1.96  # 97.5 % quantile of the standard normal distribution


def compute_intervals(
    task: FitTask, description: Description, found: Fit
) -> tuple[Mapping[str, tuple[float, float]], ...]:
    """Return the 95 % confidence intervals of the effects' parameters, by name for each effect.

    Squares of half-widths are added: from the curvature of the loss with the base parameters free, from the variance
    between recorded episodes (clustered sandwich estimator with Student's t; Liang and Zeger, 1986), and from small
    differences between two formulations of an effect. Errors above the noise floor are systematic and do not average
    out, so that the half-width is multiplied by their size in floors. The interval is the union of those around the
    values of this fit and of freer fits, without shared values and with optional parameters. An effect that adds to a
    quantity of the model, such as damping, is uncertain by at least the tolerance of that quantity.

    Args:
        task: Model and episodes.
        description: Structure of the fit.
        found: Fit to the episodes.
    """
    widths = np.hypot(compute_curvature_widths(task, found), compute_episode_widths(task, found))
    ratios, freer = compute_error_ratios(task, found), fit_freer_forms(task, description, found)
    result: list[dict[str, tuple[float, float]]] = [{} for _ in found.effects]
    rows = zip(found.parameters.effect_parameters, found.theta, widths, ratios, strict=False)
    for free, number, width, ratio in rows:
        form_width = NORMAL95 * FORM_DEVIATION * abs(float(number) if free.signed else 1.0)
        half_width = float(np.hypot(width, form_width) * ratio)
        for place in free.effect_indices:
            shared_half_width = NORMAL95 * find_existing_deviation(task, found.effects[place], free.parameter)
            values = [free.value(float(number)), *(getattr(form[place], free.parameter.name) for form in freer)]
            low = min(free.move(value, -half_width) for value in values) - shared_half_width
            high = max(free.move(value, half_width) for value in values) + shared_half_width
            low, high = np.clip([low, high], free.parameter.low, free.parameter.high).tolist()
            result[place][free.parameter.name] = (low, high)
    return tuple(result)


def compute_curvature_widths(task: FitTask, found: Fit) -> np.ndarray:
    """Return the half-widths of θ from the curvature of the loss, shape (size,).

    Rows within `CORRELATION` count as one, because errors of a rollout are correlated.
    """
    return np.asarray(NORMAL95 * np.sqrt(np.clip(np.diag(compute_inverse_hessian(task, found)), 0.0, None)))


def compute_error_ratios(task: FitTask, found: Fit) -> np.ndarray:
    """Return the remaining error over the noise floor in the joints that θ moves, at least 1, shape (size,).

    It is the root mean square over joints, each with the share of its rows in the curvature of the loss.
    """
    columns, _ = task.absorb_change(found.jacobian)
    shares = ((columns * task.weights(found.predicted)) ** 2).sum(axis=(1, 2))
    squares = compute_floor_ratios(task.mean_squares(found.predicted), task.floors) ** 2
    return np.sqrt(np.maximum(shares @ squares / np.maximum(shares.sum(axis=1), 1e-300), 1.0))


def compute_episode_widths(task: FitTask, found: Fit) -> np.ndarray:
    """Return the half-widths of θ from the variance between recorded episodes, shape (size,)."""
    recordings = number_recordings(task.evidence)
    weights = task.weights(found.predicted) * task.evidence.mask[..., None]
    (errors, _), (columns, _) = task.errors(found.predicted), task.absorb_change(found.jacobian)
    windows = len(task.evidence)
    rows = (columns * weights).reshape(len(columns), windows, -1)
    steps = compute_inverse_hessian(task, found) @ np.einsum(
        "pet,et->pe", rows, (errors * weights).reshape(windows, -1)
    )
    count = int(recordings.max()) + 1
    totals = np.stack([steps[:, recordings == number].sum(1) for number in range(count)])
    if count < 2:
        return np.zeros(len(columns))
    return np.asarray(stdtrit(count - 1, 0.975) * np.sqrt((totals**2).sum(0) * count / (count - 1)))


def number_recordings(evidence: EpisodeBatch) -> np.ndarray:
    """Return the index of each window's recorded episode, or its own if few were recorded, shape (E,)."""
    numbers, recordings = np.unique(evidence.numbers, return_inverse=True)
    return recordings if len(numbers) >= FEWEST_RECORDINGS else np.arange(len(evidence))


def fit_freer_forms(task: FitTask, description: Description, found: Fit) -> list[tuple[Effect, ...]]:
    """Return the effects in fits without shared values, and with optional parameters as well.

    A fit that has nothing to free, or has not converged, is left out.

    Args:
        task: Model and episodes.
        description: Structure of the fit.
        found: Fit to the episodes.
    """
    estimated = estimate_scales(task.nominal, task.evidence, found.predicted)
    scales = dict(zip(task.nominal.joints, estimated, strict=True))
    forms, last, near = [], replace(description, effects=found.effects), found
    for optional in (False, True):
        freed = [e.with_optional_parameters(scales.get(e.joint or "")) if optional else e for e in near.effects]
        freer = replace(description, effects=tuple(freed), shared=frozenset())
        if freer == last:
            continue
        parameters = freer.parameters(task.nominal.base)
        known = reuse_jacobian(near, parameters)
        other = fit(task, parameters, parameters.initial_theta(near.factors), known, steps=4, jacobian_refreshes=1)
        if other is not None and other.loss < near.loss + PARAMETER_PRICE:
            forms.append(other.effects)
            last, near = replace(freer, effects=other.effects), other
    return forms


def find_existing_deviation(task: FitTask, effect: Effect, parameter: Parameter) -> float:
    """Return the standard deviation of the model's quantity that an effect's first parameter adds to [its unit]."""
    if not effect.replaces or effect.joint is None or parameter is not effect.parameters[0]:
        return 0.0
    own = f"{effect.joint}.{effect.replaces}"
    tolerance = next((base.tolerance for base in task.nominal.base if base.name == own), TOLERANCE)
    return tolerance * read_own_amount(task.nominal.spec, effect.joint, effect.replaces)
