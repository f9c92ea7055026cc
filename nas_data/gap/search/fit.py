"""Fit a hypothesis to episodes: Gauss-Newton on open-loop rollouts, robust between episodes and between joints."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from nas_data.effects.base import Effect
from nas_data.gap.search.objective import FitTask, Reach, Score
from nas_data.gap.search.parameters import STEP, FreeParameters, Label
from nas_data.gap.side_by_side import side_by_side

DAMPING = (0.0, 0.003, 0.01, 0.03, 0.1, 1.0, 10.0)  # Levenberg-Marquardt: how cautious a step is, tried in this order
ENOUGH = 1e-3  # relative improvement of the loss below which a fit has converged
LONGEST_LIFE = 3  # steps after which the Jacobian is measured anew, where it may be
BESIDES = 0.15  # share of a number's effect that may fall on other joints and be neglected when it is measured
LONGEST_STEP = 1.5  # of any number in one step: a factor of 4.5 in a parameter


@dataclass(frozen=True)
class Fit:
    """A fitted hypothesis.

    Attributes:
        parameters: The hypothesis.
        theta: Fitted numbers.
        predicted: Positions [rad], shape (E, T, n).
        misfit: Misfit without prior.
        jacobian: Change of the positions per number, shape (size, E, T, n).
        objective: Which objective the misfit is of.
    """

    parameters: FreeParameters
    theta: np.ndarray
    predicted: np.ndarray
    misfit: float
    jacobian: np.ndarray
    objective: int

    def select(self, task: FitTask, episodes: Sequence[int] | np.ndarray) -> "Fit":
        """Return the fit as seen on some of its episodes, of which `task` consists."""
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
        return Score(self.misfit + penalty(self.parameters, self.theta), self.objective)

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The fitted effects."""
        return self.parameters.effects_at(self.theta)

    @property
    def factors(self) -> dict[str, float]:
        """The fitted factors of the model's parameters, by name."""
        return self.parameters.factors_at(self.theta)


def penalty(parameters: FreeParameters, theta: np.ndarray) -> float:
    """Return the prior's part of the loss."""
    return float(0.5 * ((parameters.prior(theta) * theta) ** 2).sum())


def loss(task: FitTask, parameters: FreeParameters, theta: np.ndarray) -> Score:
    """Return misfit and prior at some numbers; infinite where the model diverges."""
    return Score(task.misfit(task.predict(parameters, theta)) + penalty(parameters, theta), task.objective)


def measure_jacobian(
    task: FitTask, parameters: FreeParameters, theta: np.ndarray, predicted: np.ndarray, columns: Sequence[int]
) -> np.ndarray:
    """Return finite differences of the positions by some of the numbers, shape (columns, E, T, n).

    Numbers that move different joints are moved in one rollout (Curtis, Powell and Reid, 1974).
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
    for group, change in zip(groups, side_by_side(difference, groups), strict=True):
        for column in group:
            seen = slice(None) if len(group) == 1 else moved_joints(task, parameters, column)
            jacobian[place[column]][..., seen] = change[..., seen] / steps[column]
    return jacobian


def group_columns(task: FitTask, parameters: FreeParameters, columns: Sequence[int]) -> list[list[int]]:
    """Return groups of numbers of which no two move the same joint, as far as the task knows whom they move."""
    groups: list[tuple[list[int], np.ndarray]] = []
    for column in columns:
        seen = moved_joints(task, parameters, column)
        fitting = [] if seen is None else [group for group in groups if not (group[1] & seen).any()]
        if fitting:
            fitting[0][0].append(column)
            fitting[0][1][:] |= seen
        else:
            groups.append(([column], np.ones(len(task.floor), bool) if seen is None else seen.copy()))
    return [group for group, _ in groups]


def moved_joints(task: FitTask, parameters: FreeParameters, column: int) -> np.ndarray | None:
    """Return which joints a number moves, shape (n,); None where that is not known."""
    label = parameters.labels[column]
    if not is_loose(parameters, column):
        return task.reach.get(label[0])
    return task.reach_of_joints.get(joint_of_label(label))


def joint_of_label(label: Label) -> str | None:
    """Return the joint of an effect's number or of a parameter of the model; None for one of the arm."""
    return label[1] if len(label) > 1 else str(label[0]).rsplit(".", 1)[0]


def is_loose(parameters: FreeParameters, column: int) -> bool:
    """Whether a number is an effect's, or of a parameter of the model that may be anything."""
    base = column - len(parameters.of_effects)
    return base < 0 or parameters.base[base].is_free


def reach_of_joints(task: FitTask, parameters: FreeParameters) -> Reach:
    """Return which joints are moved by what is changed at each joint, masses apart, by its name."""
    found: dict[str | None, np.ndarray] = {}
    for parameter in parameters.base:
        if parameter.kind != "mass" and parameter.name in task.reach:
            found[parameter.joint] = found.get(parameter.joint, False) | task.reach[parameter.name]
    return found


def measure_reach(task: FitTask, parameters: FreeParameters, predicted: np.ndarray, jacobian: np.ndarray) -> Reach:
    """Return which joints each parameter of the model moves, by its name: those with a share of its whole effect."""
    weights = task.weights(predicted) * task.evidence.mask[..., None]
    sizes = np.sqrt(((jacobian * weights) ** 2).sum((1, 2)))
    shares = sizes / np.maximum(np.linalg.norm(sizes, axis=1, keepdims=True), 1e-300)
    names = (label[0] for label in parameters.labels)
    return {name: share > BESIDES for name, share in zip(names, shares, strict=True) if name}


def fit(
    task: FitTask,
    parameters: FreeParameters,
    theta: np.ndarray,
    known: Mapping[int, np.ndarray] | None = None,
    steps: int = 6,
    jacobian_refreshes: int = 2,
) -> Fit | None:
    """Fit a hypothesis.

    The columns of the Jacobian that belong to effects are measured before each step. Those of the model's parameters,
    and those known from another fit, are updated as Broyden does: they hardly change, and each costs a rollout.

    Args:
        task: Model and episodes.
        parameters: Hypothesis.
        theta: Where to start, shape (size,).
        known: Columns found elsewhere, by the number's index, each of shape (E, T, n).
        steps: Most Gauss-Newton steps.
        jacobian_refreshes: How often the columns of effects and freed parameters may be measured anew, where a step
            with old ones brings little; where there are none, those of the model's parameters.

    Returns:
        The fit, None where the model diverges at the start.
    """
    low, high = parameters.bounds()
    theta = np.clip(theta, low, high)
    predicted = task.predict(parameters, theta)
    if predicted is None:
        return None
    every, known = range(parameters.size), known or {}
    again = [column for column in every if is_loose(parameters, column)] or list(every)
    measured_always = [column for column in range(len(parameters.of_effects)) if column not in known]
    loss = task.misfit(predicted) + penalty(parameters, theta)
    jacobian = np.zeros((parameters.size, *predicted.shape))
    jacobian[list(known)] = [known[column] for column in known] if known else 0.0
    missing = [column for column in every if column not in known]
    jacobian[missing] = measure_jacobian(task, parameters, theta, predicted, missing)
    age, fresh = 0, not known
    for number in range(steps):
        if number and measured_always and not fresh:
            columns = measured_always
            jacobian[columns] = measure_jacobian(task, parameters, theta, predicted, columns)
        found = step(task, parameters, theta, predicted, jacobian, loss)
        little = found is None
        if found is not None:
            moved, other, better = found
            jacobian = jacobian + broyden(jacobian, moved - theta, other - predicted)
            little = loss - better < smallest_gain(task)
            theta, predicted, loss = moved, other, better
        if little and (fresh or not jacobian_refreshes):
            break
        age, fresh = age + 1, False
        if jacobian_refreshes and (little or age >= LONGEST_LIFE) and number + 1 < steps:
            jacobian[again] = measure_jacobian(task, parameters, theta, predicted, again)
            jacobian_refreshes, age, fresh = jacobian_refreshes - 1, 0, True
    return Fit(parameters, theta, predicted, task.misfit(predicted), jacobian, task.objective)


def smallest_gain(task: FitTask) -> float:
    """Return the improvement of the loss below which a fit has converged [nats]."""
    return ENOUGH * max(1.0, float(task.observations.sum()))


def broyden(jacobian: np.ndarray, change: np.ndarray, moved: np.ndarray) -> np.ndarray:
    """Return the smallest correction of a Jacobian that explains how the positions moved, shape (size, E, T, n)."""
    missing = moved - np.tensordot(change, jacobian, 1)
    return np.asarray(change[:, None, None, None] * missing[None] / max(float(change @ change), 1e-12))


def normal_equations(task: FitTask, predicted: np.ndarray, jacobian: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return Jᵀ W J and Jᵀ W e of the weighted errors, shapes (size, size) and (size,)."""
    weights = task.weights(predicted) * task.evidence.mask[..., None]
    rows = (jacobian * weights).reshape(len(jacobian), -1)
    errors = (task.evidence.errors(predicted) * weights).ravel()
    return rows @ rows.T, rows @ errors


def step(
    task: FitTask,
    parameters: FreeParameters,
    theta: np.ndarray,
    predicted: np.ndarray,
    jacobian: np.ndarray,
    loss: float,
) -> tuple[np.ndarray, np.ndarray, float] | None:
    """Return numbers, positions and loss after one step that lowers the loss; None where none does or promises to."""
    low, high = parameters.bounds()
    square, pull = normal_equations(task, predicted, jacobian)
    before = penalty(parameters, theta)

    def wanted(prior: np.ndarray, damping: float) -> np.ndarray:
        return solve_bounded(square + np.diag(prior), pull + prior * theta, damping, low - theta, high - theta)

    for damping in DAMPING:
        change = wanted(parameters.prior(theta) ** 2, damping)
        change = wanted(parameters.prior(theta + change) ** 2, damping)  # which is another where a sign changes
        change *= min(1.0, LONGEST_STEP / max(float(np.abs(change).max()), 1e-12))
        moved = np.clip(theta + change, low, high)
        change = moved - theta
        promised = -float(pull @ change + 0.5 * change @ square @ change) + before - penalty(parameters, moved)
        if promised < smallest_gain(task):
            return None
        other = task.predict(parameters, moved)
        better = task.misfit(other) + penalty(parameters, moved)
        if other is not None and better < loss:
            return moved, other, better
    return None


def solve_bounded(
    square: np.ndarray, pull: np.ndarray, damping: float, low: np.ndarray, high: np.ndarray
) -> np.ndarray:
    """Return the damped Gauss-Newton change within bounds: what runs into one stays there, the others go on."""
    size = len(pull)
    change = np.zeros(size)
    free = np.ones(size, bool)
    lifted = square + np.diag(damping * np.diag(square) + 1e-9 * (1 + np.trace(square) / size))
    for _ in range(size):
        fixed = ~free
        if not free.any():
            break
        right = -pull[free] - lifted[np.ix_(free, fixed)] @ change[fixed]
        change[free] = np.linalg.solve(lifted[np.ix_(free, free)], right)
        beyond = free & ((change < low - 1e-12) | (change > high + 1e-12))
        if not beyond.any():
            break
        change[beyond] = np.clip(change[beyond], low[beyond], high[beyond])
        free &= ~beyond
    return change
