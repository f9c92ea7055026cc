"""Fit one factor for all joints, from which a fit of every joint by itself can begin."""

import numpy as np

from nas_data.gap.search.fit import (
    DAMPING,
    MAX_STEP,
    build_normal_equations,
    compute_convergence_tolerance,
    compute_prior_penalty,
    measure_jacobian,
)
from nas_data.gap.search.objective import FitTask
from nas_data.gap.search.parameters import FreeParameters

STEPS = 4  # most steps; each measures every column


def fit_alike(task: FitTask, parameters: FreeParameters, theta: np.ndarray) -> np.ndarray:
    """Fit one factor for all freed parameters of a kind, such as all gains; return θ, shape (size,).

    Servos of one arm are often alike. A fit of every number by itself that begins there does not go astray along the
    ridges on which gain, friction and inertia of a joint stand for each other.

    Args:
        task: Model and episodes.
        parameters: Free parameters.
        theta: Initial values, shape (size,).
    """
    tie = tie_kinds(parameters)
    predicted = task.predict(parameters, theta)
    for _ in range(STEPS):
        if predicted is None:
            break
        loss = task.misfit(predicted) + compute_prior_penalty(parameters, theta)
        jacobian = measure_jacobian(task, parameters, theta, predicted, range(parameters.size))
        moved = take_tied_step(task, parameters, theta, predicted, jacobian, tie)
        if moved is None:
            break
        theta, predicted = moved
        if loss - task.misfit(predicted) - compute_prior_penalty(parameters, theta) < compute_convergence_tolerance(
            task
        ):
            break
    return theta


def tie_kinds(parameters: FreeParameters) -> np.ndarray:
    """Return which freed parameters belong to each kind, shape (size, kinds), as 0 and 1."""
    freed = {parameter.name: parameter.kind for parameter in parameters.base if parameter.is_free}
    own = [freed.get(str(label[0]), "") for label in parameters.labels]
    return np.array([[kind == other for other in sorted(set(freed.values()))] for kind in own], float)


def take_tied_step(
    task: FitTask,
    parameters: FreeParameters,
    theta: np.ndarray,
    predicted: np.ndarray,
    jacobian: np.ndarray,
    tie: np.ndarray,
) -> tuple[np.ndarray, np.ndarray] | None:
    """Return θ and positions after a step of the factors that lowers the loss; None if no damping achieves that."""
    low, high = parameters.bounds()
    hessian, gradient = build_normal_equations(task, predicted, jacobian)
    prior = parameters.prior_weights(theta) ** 2
    curvature, slope = tie.T @ (hessian + np.diag(prior)) @ tie, tie.T @ (gradient + prior * theta)
    loss = task.misfit(predicted) + compute_prior_penalty(parameters, theta)
    for damping in DAMPING:
        change = -np.linalg.solve(curvature + (damping + 1e-9) * np.diag(np.diag(curvature)), slope)
        change *= min(1.0, MAX_STEP / max(float(np.abs(change).max()), 1e-12))
        moved = np.clip(theta + tie @ change, low, high)
        other = task.predict(parameters, moved)
        if other is not None and task.misfit(other) + compute_prior_penalty(parameters, moved) < loss:
            return moved, other
    return None
