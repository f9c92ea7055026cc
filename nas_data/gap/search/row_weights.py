"""Weights of rows whose motion cannot be predicted, because it depends on the parameters chaotically."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from nas_data.gap.search.fit import Fit, compute_inverse_hessian, compute_prior_penalty
from nas_data.gap.search.objective import FitTask
from nas_data.gap.side_by_side import map_in_parallel

FIRST_CHANGES = 4  # random changes of the parameters; without chaotic rows, no more are made
CHANGES = 16  # changes in all
CHANGE = 0.3  # size of a change in standard deviations of the fit: a linear response to it is far below the errors
MAX_CHANGE = 0.1  # largest change of θ, where the data hardly determine a parameter


def weigh_rows(fitted: FitTask, held: FitTask, found: Fit) -> tuple[FitTask, FitTask, np.ndarray]:
    """Weigh rows by how well a fit predicts them, and find the best start among random changes of its parameters.

    A joint with play may reach one stop or the other after a change of the parameters that the data cannot see. Its
    errors then differ by degrees for about a second, and the misfit by many nats. Let σ_c be the spread of the
    positions under small random changes of all parameters, and v the tolerance plus the median squared error of the
    episode and joint. The weight of a row is min(1, √v / σ_c). The changes have a fixed seed.

    Args:
        fitted: Fitted episodes.
        held: Held-out episodes.
        found: Fit to the fitted episodes.

    Returns:
        Fitted and held-out episodes with row weights, and the θ with the lowest loss on both, of shape (size,): that
        of the fit or, if there are unpredictable rows, perhaps of a change.
    """
    parameters = found.parameters
    tried = [found.theta, *draw_changes(fitted, found)]

    def roll_out(theta: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        both = fitted.predict(parameters, theta), held.predict(parameters, theta)
        return None if both[0] is None or both[1] is None else (both[0], both[1])

    rollouts: list[tuple[np.ndarray, np.ndarray] | None] = []
    for changes in (FIRST_CHANGES, CHANGES):
        rollouts += map_in_parallel(roll_out, tried[len(rollouts) : 1 + changes])
        if rollouts[0] is None:
            return replace(fitted, row_weights=1.0), replace(held, row_weights=1.0), found.theta
        known = [each for each in rollouts if each is not None]
        fitted, held = (
            replace(task, row_weights=compute_row_weights(task, [each[place] for each in known]))
            for place, task in enumerate((fitted, held))
        )
        if not (fitted.has_unpredictable_rows or held.has_unpredictable_rows):
            return fitted, held, found.theta

    def measure_loss(number: int) -> float:
        rolled = rollouts[number]
        if rolled is None:
            return np.inf
        return fitted.misfit(rolled[0]) + held.misfit(rolled[1]) + compute_prior_penalty(parameters, tried[number])

    return fitted, held, tried[min(range(len(tried)), key=measure_loss)]


def draw_changes(task: FitTask, found: Fit) -> np.ndarray:
    """Return θ after small random changes by the normal approximation of its posterior, shape (CHANGES, size)."""
    values, vectors = np.linalg.eigh(compute_inverse_hessian(task, found))
    draws = np.random.default_rng(0).standard_normal((CHANGES, len(values)))
    changes = CHANGE * (draws * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
    return np.clip(found.theta + np.clip(changes, -MAX_CHANGE, MAX_CHANGE), *found.parameters.bounds())


def compute_row_weights(task: FitTask, rollouts: Sequence[np.ndarray]) -> np.ndarray:
    """Return the weights of a task's rows, shape (E, T, n).

    Args:
        task: Model and episodes.
        rollouts: Positions of the fit, then after changes of its parameters [rad; m], each of shape (E, T, n).
    """
    centre, *others = rollouts
    spread = np.sqrt(np.mean([(other - centre) ** 2 for other in others or [centre]], axis=0))
    squares = np.where(task.evidence.mask[..., None], task.evidence.errors(centre) ** 2, np.nan)
    limit = np.sqrt(task.tolerance[:, None] + np.nanmedian(squares, axis=1, keepdims=True))
    return np.minimum(1.0, limit / np.maximum(spread, 1e-12))
