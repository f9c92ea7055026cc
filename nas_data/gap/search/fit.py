"""Fit a hypothesis to episodes by Gauss-Newton steps on open-loop rollouts."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from nas_data.effects.base import Effect
from nas_data.gap.search.constants import CONVERGED_GAIN
from nas_data.gap.search.objective import FitTask, MovedJoints
from nas_data.gap.search.parameters import STEP, FreeParameters
from nas_data.gap.search.score import Score
from nas_data.gap.side_by_side import map_in_parallel

DAMPING = (0.0, 0.01, 0.1, 1.0, 10.0)  # Levenberg-Marquardt damping, tried in this order
MAX_JACOBIAN_AGE = 3  # steps after which the Jacobian is measured again, if allowed
NEGLECTED_SHARE = 0.15  # share of a column's norm in other joints that is neglected
MAX_STEP = 1.5  # largest step of θ, a factor of 4.5 in a parameter


@dataclass(frozen=True)
class Expansion:
    """Second-order expansion of other episodes' misfit about θ₀, gᵀ Δθ + ½ Δθᵀ H Δθ [nats].

    Attributes:
        theta: θ₀, shape (size,).
        hessian: H, shape (size, size).
        gradient: g, shape (size,).
    """

    theta: np.ndarray
    hessian: np.ndarray
    gradient: np.ndarray

    @classmethod
    def zero(cls, size: int) -> "Expansion":
        """Return the expansion without other episodes."""
        return cls(np.zeros(size), np.zeros((size, size)), np.zeros(size))

    def measure(self, theta: np.ndarray) -> float:
        """Return the change of the misfit at θ [nats]."""
        change = theta - self.theta
        return float(self.gradient @ change + 0.5 * change @ self.hessian @ change)

    def slope(self, theta: np.ndarray) -> np.ndarray:
        """Return the gradient at θ, shape (size,)."""
        return np.asarray(self.gradient + self.hessian @ (theta - self.theta))


@dataclass(frozen=True)
class Fit:
    """A fitted hypothesis.

    Attributes:
        parameters: Free parameters.
        theta: Fitted values, shape (size,).
        predicted: Positions [rad; m], shape (E, T, n).
        misfit: Misfit without prior [nats].
        jacobian: Derivatives of the positions by θ, shape (size, E, T, n).
        objective: Number of the objective to which the misfit belongs.
    """

    parameters: FreeParameters
    theta: np.ndarray
    predicted: np.ndarray
    misfit: float
    jacobian: np.ndarray
    objective: int

    def select(self, task: FitTask, episodes: Sequence[int] | np.ndarray) -> "Fit":
        """Return the fit restricted to some episodes, which are those of `task`."""
        chosen = list(episodes)
        predicted = self.predicted[chosen]
        return replace(
            self,
            predicted=predicted,
            misfit=task.misfit(predicted),
            jacobian=self.jacobian[:, chosen],
            objective=task.objective,
        )

    @property
    def loss(self) -> Score:
        """Misfit and prior."""
        return Score(self.misfit + compute_prior_penalty(self.parameters, self.theta), self.objective)

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The fitted effects."""
        return self.parameters.effects_at(self.theta)

    @property
    def factors(self) -> dict[str, float]:
        """The fitted factors of the model's parameters, by name."""
        return self.parameters.factors_at(self.theta)


def compute_prior_penalty(parameters: FreeParameters, theta: np.ndarray) -> float:
    """Return the prior's part of the loss, ½ Σ (θ / σ)² [nats]."""
    return float(0.5 * ((parameters.prior_weights(theta) * theta) ** 2).sum())


def evaluate_loss(task: FitTask, parameters: FreeParameters, theta: np.ndarray) -> Score:
    """Return misfit and prior at θ; infinite if the model diverges."""
    return Score(
        task.misfit(task.predict(parameters, theta)) + compute_prior_penalty(parameters, theta), task.objective
    )


def measure_jacobian(
    task: FitTask, parameters: FreeParameters, theta: np.ndarray, predicted: np.ndarray, columns: Sequence[int]
) -> np.ndarray:
    """Return finite differences of the positions by some of θ, shape (columns, E, T, n).

    Parameters that move different joints share a rollout (Curtis, Powell and Reid, 1974).
    """
    _, high = parameters.bounds()
    steps = np.where(theta + STEP <= high, STEP, -STEP)
    groups = group_columns(task, parameters, columns)

    def difference(group: Sequence[int]) -> np.ndarray:
        moved = theta.copy()
        moved[group] += steps[group]
        other = task.predict(parameters, moved)
        return np.zeros_like(predicted) if other is None else other - predicted

    place = {column: row for row, column in enumerate(columns)}
    jacobian = np.zeros((len(columns), *predicted.shape))
    for group, change in zip(groups, map_in_parallel(difference, groups), strict=True):
        for column in group:
            seen = slice(None) if len(group) == 1 else find_moved_joints(task, parameters, column)
            jacobian[place[column]][..., seen] = change[..., seen] / steps[column]
    return jacobian


def group_columns(task: FitTask, parameters: FreeParameters, columns: Sequence[int]) -> list[list[int]]:
    """Group columns so that no two of a group move the same joint, as far as that is known."""
    groups: list[tuple[list[int], np.ndarray]] = []
    for column in columns:
        seen = find_moved_joints(task, parameters, column)
        fitting = [] if seen is None else [group for group in groups if not (group[1] & seen).any()]
        if fitting:
            fitting[0][0].append(column)
            fitting[0][1][:] |= seen
        else:
            groups.append(([column], np.ones(len(task.floor), bool) if seen is None else seen.copy()))
    return [group for group, _ in groups]


def find_moved_joints(task: FitTask, parameters: FreeParameters, column: int) -> np.ndarray | None:
    """Return a mask of the joints that a parameter moves, shape (n,); None if unknown."""
    if not is_effect_or_freed(parameters, column):
        return task.moved_by_base.get(parameters.labels[column][0])
    joint = parameters.find_local_joint(column)
    return None if joint is None else task.moved_by_joint.get(joint)


def is_effect_or_freed(parameters: FreeParameters, column: int) -> bool:
    """Whether a column belongs to an effect or to a freed parameter of the model."""
    base = column - len(parameters.effect_parameters)
    return base < 0 or parameters.base[base].is_free


def group_moved_joints(task: FitTask, parameters: FreeParameters) -> MovedJoints:
    """Return masks of the joints that the base parameters of each joint move, masses excepted."""
    found: dict[str | None, np.ndarray] = {}
    for parameter in parameters.base:
        if parameter.kind != "mass" and parameter.name in task.moved_by_base:
            found[parameter.joint] = found.get(parameter.joint, False) | task.moved_by_base[parameter.name]
    return found


def measure_moved_joints(
    task: FitTask, parameters: FreeParameters, predicted: np.ndarray, jacobian: np.ndarray
) -> MovedJoints:
    """Return masks of the joints that each parameter moves: those with a sufficient share of its column's norm."""
    weights = task.weights(predicted) * task.evidence.mask[..., None]
    sizes = np.sqrt(((jacobian * weights) ** 2).sum((1, 2)))
    shares = sizes / np.maximum(np.linalg.norm(sizes, axis=1, keepdims=True), 1e-300)
    names = (label[0] for label in parameters.labels)
    return {name: share > NEGLECTED_SHARE for name, share in zip(names, shares, strict=True) if name}


def fit(
    task: FitTask,
    parameters: FreeParameters,
    theta: np.ndarray,
    known: Mapping[int, np.ndarray] | None = None,
    steps: int = 6,
    jacobian_refreshes: int = 2,
    others: Expansion | None = None,
) -> Fit | None:
    """Fit a hypothesis by damped Gauss-Newton steps.

    Columns of effects are measured before each step. Columns of the model's parameters and columns from another fit are
    updated by Broyden's formula, since they change little and each costs a rollout.

    Args:
        task: Model and episodes.
        parameters: Free parameters of the hypothesis.
        theta: Initial values, shape (size,).
        known: Columns from another fit by index, each of shape (E, T, n).
        steps: Largest number of steps.
        jacobian_refreshes: Number of times that columns of effects and freed parameters may be measured again when a
            step gains little. Without such columns, those of the model's parameters are measured.
        others: Misfit of further episodes that the hypothesis has to explain, expanded; none if None.

    Returns:
        The fit; None if the model diverges at the initial values.
    """
    low, high = parameters.bounds()
    theta = np.clip(theta, low, high)
    predicted = task.predict(parameters, theta)
    if predicted is None:
        return None
    every, known = range(parameters.size), known or {}
    again = [column for column in every if is_effect_or_freed(parameters, column)] or list(every)
    measured_always = [column for column in range(len(parameters.effect_parameters)) if column not in known]
    others = others or Expansion.zero(parameters.size)
    loss = task.misfit(predicted) + compute_prior_penalty(parameters, theta) + others.measure(theta)
    jacobian = np.zeros((parameters.size, *predicted.shape))
    jacobian[list(known)] = [known[column] for column in known] if known else 0.0
    missing = [column for column in every if column not in known]
    jacobian[missing] = measure_jacobian(task, parameters, theta, predicted, missing)
    age, fresh, first = 0, not known, 0
    for number in range(steps):
        if number and measured_always and not fresh:
            columns = measured_always
            jacobian[columns] = measure_jacobian(task, parameters, theta, predicted, columns)
        found = take_step(task, parameters, theta, predicted, jacobian, loss, DAMPING[first:], others)
        little = found is None
        if found is not None:
            moved, other, better, damping = found
            first = max(0, DAMPING.index(damping) - 1)
            jacobian = jacobian + broyden_update(jacobian, moved - theta, other - predicted)
            little = loss - better < compute_convergence_tolerance(task)
            theta, predicted, loss = moved, other, better
        if little and (fresh or not jacobian_refreshes):
            break
        age, fresh = age + 1, False
        if jacobian_refreshes and (little or age >= MAX_JACOBIAN_AGE) and number + 1 < steps:
            jacobian[again] = measure_jacobian(task, parameters, theta, predicted, again)
            jacobian_refreshes, age, fresh, first = jacobian_refreshes - 1, 0, True, 0
    return Fit(parameters, theta, predicted, task.misfit(predicted), jacobian, task.objective)


def compute_convergence_tolerance(task: FitTask) -> float:
    """Return the gain of the loss below which a fit has converged [nats]."""
    return CONVERGED_GAIN * max(1.0, float(task.observations.sum()))


def broyden_update(jacobian: np.ndarray, change: np.ndarray, moved: np.ndarray) -> np.ndarray:
    """Return the smallest update of a Jacobian that explains a step's change of positions, shape (size, E, T, n)."""
    missing = moved - np.tensordot(change, jacobian, 1)
    return np.asarray(change[:, None, None, None] * missing[None] / max(float(change @ change), 1e-12))


def build_normal_equations(task: FitTask, predicted: np.ndarray, jacobian: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return Hessian JᵀWJ, shape (size, size), and gradient JᵀWe, shape (size,), of the weighted errors.

    Uncertain initial states are eliminated: a change of θ also changes the most likely ones.
    """
    weights = task.weights(predicted) * task.evidence.mask[..., None]
    (errors, starts), (columns, start_columns) = task.errors(predicted), task.absorb_change(jacobian)
    size = len(jacobian)
    rows = np.concatenate([(columns * weights).reshape(size, -1), start_columns.reshape(size, -1)], axis=1)
    return rows @ rows.T, rows @ np.concatenate([(errors * weights).ravel(), starts.ravel()])


def compute_inverse_hessian(task: FitTask, found: Fit) -> np.ndarray:
    """Return (JᵀWJ + prior)⁻¹ of a fit, shape (size, size)."""
    hessian, _ = build_normal_equations(task, found.predicted, found.jacobian)
    prior = np.diag(found.parameters.prior_weights(found.theta) ** 2)
    return np.asarray(np.linalg.pinv(hessian + prior + 1e-9 * np.eye(len(hessian))))


def take_step(
    task: FitTask,
    parameters: FreeParameters,
    theta: np.ndarray,
    predicted: np.ndarray,
    jacobian: np.ndarray,
    loss: float,
    dampings: Sequence[float],
    others: Expansion,
) -> tuple[np.ndarray, np.ndarray, float, float] | None:
    """Return θ, positions, loss and damping of a step that lowers the loss; None if no damping gains or promises it."""
    low, high = parameters.bounds()
    hessian, gradient = build_normal_equations(task, predicted, jacobian)
    hessian, gradient = hessian + others.hessian, gradient + others.slope(theta)
    before = compute_prior_penalty(parameters, theta)

    def solve(prior: np.ndarray, damping: float) -> np.ndarray:
        return solve_bounded(hessian + np.diag(prior), gradient + prior * theta, damping, low - theta, high - theta)

    for damping in dampings:
        change = solve(parameters.prior_weights(theta) ** 2, damping)
        change = solve(parameters.prior_weights(theta + change) ** 2, damping)  # the prior depends on the sign of θ
        change *= min(1.0, MAX_STEP / max(float(np.abs(change).max()), 1e-12))
        moved = np.clip(theta + change, low, high)
        change = moved - theta
        expected_gain = (
            -float(gradient @ change + 0.5 * change @ hessian @ change)
            + before
            - compute_prior_penalty(parameters, moved)
        )
        if expected_gain < compute_convergence_tolerance(task):
            return None
        other = task.predict(parameters, moved)
        better = task.misfit(other) + compute_prior_penalty(parameters, moved) + others.measure(moved)
        if other is not None and better < loss:
            return moved, other, better, damping
    return None


def solve_bounded(
    hessian: np.ndarray, gradient: np.ndarray, damping: float, low: np.ndarray, high: np.ndarray
) -> np.ndarray:
    """Return the damped Gauss-Newton step within bounds, shape (size,).

    Parameters that reach a bound are fixed there, and the others are solved again.
    """
    size = len(gradient)
    change = np.zeros(size)
    free = np.ones(size, bool)
    damped = hessian + np.diag(damping * np.diag(hessian) + 1e-9 * (1 + np.trace(hessian) / size))
    for _ in range(size):
        fixed = ~free
        if not free.any():
            break
        right = -gradient[free] - damped[np.ix_(free, fixed)] @ change[fixed]
        change[free] = np.linalg.solve(damped[np.ix_(free, free)], right)
        beyond = free & ((change < low - 1e-12) | (change > high + 1e-12))
        if not beyond.any():
            break
        change[beyond] = np.clip(change[beyond], low[beyond], high[beyond])
        free &= ~beyond
    return change
