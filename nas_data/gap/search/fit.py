"""Fit a hypothesis to episodes: Gauss-Newton on open-loop rollouts, robust between episodes and between joints."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from nas_data.effects.base import Effect
from nas_data.errors import ModelFileError
from nas_data.gap.evidence import Evidence
from nas_data.gap.nominal import Nominal, fine_timestep, with_timestep
from nas_data.gap.search.unknowns import STEP, Unknowns
from nas_data.gap.side_by_side import side_by_side
from nas_data.simulators.settled import Hold

BEGINNING = 1.0  # [s] by which the start of an episode is told
FAMILIAR = 0.8  # mean square of the likeliest start that counts as equal to another's
COARSE = 0.1  # part of a joint's error that does not matter before the rest is explained
CORRELATION = 0.15  # [s] over which errors of a rollout are alike: so many rows count as one observation
DAMPING = (0.0, 0.003, 0.01, 0.03, 0.1, 1.0, 10.0)  # Levenberg-Marquardt: how cautious a step is, tried in this order
ENOUGH = 1e-3  # relative improvement of the loss below which a fit has converged
LONGEST_LIFE = 3  # steps after which slopes are measured anew, where they may be
LONGEST_STEP = 1.5  # of any number in one step: a factor of 4.5 in a parameter


@dataclass(frozen=True)
class Task:
    """What is fitted to what.

    Attributes:
        nominal: Model.
        evidence: Episodes.
        floor: Noise floor of each joint [rad], shape (n,).
        correction: What finer physics steps would change in the positions [rad], shape (E, T, n), or 0.
        fine: Whether the recording obeys finer physics steps than the model's own.
        coarseness: Errors of each joint that do not matter yet, while larger ones are explained [rad], shape (n,).
    """

    nominal: Nominal
    evidence: Evidence
    floor: np.ndarray
    correction: np.ndarray | float = 0.0
    coarseness: np.ndarray | float = 0.0
    fine: bool = True

    def select(self, episodes: Sequence[int] | np.ndarray) -> "Task":
        """Return the task on some of the episodes."""
        correction = self.correction if isinstance(self.correction, float) else self.correction[list(episodes)]
        return replace(self, evidence=self.evidence.select(episodes), correction=correction)

    @property
    def tolerated(self) -> np.ndarray:
        """Mean square of each joint's errors below which all are alike [rad²], shape (n,)."""
        return np.asarray(self.floor**2 + self.coarseness**2)

    def focused(self, unknowns: Unknowns, numbers: np.ndarray) -> "Task":
        """Return the task as seen from a hypothesis: how episodes began, what finer steps change, what matters now.

        A tenth of the error that is left does not matter yet. Where a joint stands still, a model may be wrong by a
        tenth of a degree or a hundredth: as long as it is wrong by degrees where the joint moves, that is no reason
        to prefer one cause to another.
        """
        effects, factors = unknowns.effects_at(numbers), unknowns.factors_at(numbers)
        task = self.begun(effects, factors).corrected(effects, factors)
        predicted = task.predict(unknowns, numbers)
        if predicted is None:
            return task
        return replace(task, coarseness=COARSE * np.sqrt(task.evidence.mean_squares(predicted).mean(0)))

    def begun(self, effects: Sequence[Effect], factors: dict[str, float]) -> "Task":
        """Return the task with what best explains how each joint of each episode began.

        Whether friction held a part of the weight, and on which side a play lay, is measured by nobody; where a
        hypothesis has such hidden states, they are told by the first second.
        """
        evidence = self.evidence
        try:
            simulator = self.nominal.simulator(effects, factors)
            if not simulator.remembers:
                return replace(self, evidence=evidence.begun(Hold.WEIGHT))
            rolled = [self.nominal.predict(evidence.begun(hold), effects, factors) for hold in Hold]
        except ModelFileError:
            return self
        begun = evidence.counts & (np.arange(evidence.counts.shape[1]) < BEGINNING / evidence.period)
        early = replace(evidence, counts=begun)
        squares = np.stack([early.mean_squares(predicted) for predicted in rolled]) + self.floor**2
        squares[Hold.WEIGHT] *= FAMILIAR
        return replace(self, evidence=evidence.begun(squares.argmin(0)))

    def corrected(self, effects: Sequence[Effect], factors: dict[str, float]) -> "Task":
        """Return the task with the correction for finer physics steps, computed at a hypothesis.

        A model's own timestep delays it by about half a step, more than the noise shows. Simulating everything in
        fine steps would cost four times as much; the difference hardly depends on the parameters.
        """
        own, small = self.nominal, with_timestep(self.nominal, self.timestep)
        if not self.fine or own.spec.option.timestep == small.spec.option.timestep:
            return replace(self, correction=0.0)
        try:
            rough, finer = (each.predict(self.evidence, effects, factors) for each in (own, small))
        except ModelFileError:
            return replace(self, correction=0.0)
        return replace(self, correction=finer - rough)

    @property
    def timestep(self) -> float:
        """The physics step for which the predictions stand [s]."""
        return fine_timestep(self.nominal) if self.fine else float(self.nominal.spec.option.timestep)

    def predict(self, unknowns: Unknowns, numbers: np.ndarray) -> np.ndarray | None:
        """Return positions (E, T, n) for fitted numbers, None where the model diverges."""
        try:
            effects, factors = unknowns.effects_at(numbers), unknowns.factors_at(numbers)
            return self.nominal.predict(self.evidence, effects, factors) + self.correction
        except ModelFileError:
            return None

    @property
    def observations(self) -> np.ndarray:
        """How many independent observations an episode is worth, shape (E, 1)."""
        return np.asarray(self.evidence.counts.sum(1)[:, None] * self.evidence.period / CORRELATION)

    def misfit(self, predicted: np.ndarray | None) -> float:
        """Return half the log of the mean squared error, summed over episodes and joints, each by its observations.

        It is the likelihood of errors whose size differs by episode and joint: no episode that went astray, and no
        joint with an effect still unnamed, rules the others.
        """
        if predicted is None:
            return np.inf
        squares = self.evidence.mean_squares(predicted)
        return float((0.5 * self.observations * np.log(self.tolerated + squares)).sum())

    def weights(self, predicted: np.ndarray) -> np.ndarray:
        """Return the weight of each error in the least squares that the misfit amounts to, shape (E, 1, n)."""
        squares = self.evidence.mean_squares(predicted)
        share = self.evidence.period / CORRELATION
        return np.asarray(np.sqrt(share / (self.tolerated + squares)))[:, None]


@dataclass(frozen=True)
class Fit:
    """A fitted hypothesis.

    Attributes:
        unknowns: The hypothesis.
        numbers: Fitted numbers.
        predicted: Positions [rad], shape (E, T, n).
        misfit: Misfit without prior.
        slopes: Change of the positions per number, shape (size, E, T, n).
    """

    unknowns: Unknowns
    numbers: np.ndarray
    predicted: np.ndarray
    misfit: float
    slopes: np.ndarray

    def select(self, task: Task, episodes: Sequence[int] | np.ndarray) -> "Fit":
        """Return the fit as seen on some of its episodes, of which `task` consists."""
        chosen = list(episodes)
        predicted = self.predicted[chosen]
        return replace(self, predicted=predicted, misfit=task.misfit(predicted), slopes=self.slopes[:, chosen])

    @property
    def loss(self) -> float:
        """Misfit and prior."""
        return self.misfit + penalty(self.unknowns, self.numbers)

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The fitted effects."""
        return self.unknowns.effects_at(self.numbers)

    @property
    def factors(self) -> dict[str, float]:
        """The fitted base factors, by name."""
        return self.unknowns.factors_at(self.numbers)


def penalty(unknowns: Unknowns, numbers: np.ndarray) -> float:
    """Return the prior's part of the loss."""
    return float(0.5 * ((unknowns.prior(numbers) * numbers) ** 2).sum())


def loss(task: Task, unknowns: Unknowns, numbers: np.ndarray) -> float:
    """Return misfit and prior at some numbers; infinite where the model diverges."""
    return task.misfit(task.predict(unknowns, numbers)) + penalty(unknowns, numbers)


def slopes(
    task: Task, unknowns: Unknowns, numbers: np.ndarray, predicted: np.ndarray, columns: Sequence[int]
) -> np.ndarray:
    """Return finite differences of the positions by some of the numbers, shape (columns, E, T, n)."""
    _, high = unknowns.bounds()

    def slope(column: int) -> np.ndarray:
        step = STEP if numbers[column] + STEP <= high[column] else -STEP
        moved = numbers.copy()
        moved[column] += step
        other = task.predict(unknowns, moved)
        return np.zeros_like(predicted) if other is None else (other - predicted) / step

    found = side_by_side(slope, columns)
    return np.stack(found) if found else np.zeros((0, *predicted.shape))


def fit(
    task: Task,
    unknowns: Unknowns,
    numbers: np.ndarray,
    lent: Mapping[int, np.ndarray] | None = None,
    steps: int = 6,
    renewals: int = 2,
) -> Fit | None:
    """Fit a hypothesis.

    The slopes by the effects' parameters are measured before each step, those by the base's and those that are lent
    are updated as Broyden does: they hardly change, and measuring them costs a rollout each.

    Args:
        task: Model and episodes.
        unknowns: Hypothesis.
        numbers: Where to start, shape (size,).
        lent: Slopes that were found elsewhere, by the number's index, each of shape (E, T, n).
        steps: Most Gauss-Newton steps.
        renewals: How often all slopes may be measured anew, where a step with old ones brings little.

    Returns:
        The fit, None where the model diverges at the start.
    """
    low, high = unknowns.bounds()
    numbers = np.clip(numbers, low, high)
    predicted = task.predict(unknowns, numbers)
    if predicted is None:
        return None
    every, lent = range(unknowns.size), lent or {}
    sought = [column for column in range(len(unknowns.sought)) if column not in lent]
    loss = task.misfit(predicted) + penalty(unknowns, numbers)
    grad = np.zeros((unknowns.size, *predicted.shape))
    grad[list(lent)] = [lent[column] for column in lent] if lent else 0.0
    missing = [column for column in every if column not in lent]
    grad[missing] = slopes(task, unknowns, numbers, predicted, missing)
    age, measured = 0, not lent
    for number in range(steps):
        if number and sought and not measured:
            grad[sought] = slopes(task, unknowns, numbers, predicted, sought)
        found = step(task, unknowns, numbers, predicted, grad, loss)
        little = found is None
        if found is not None:
            moved, other, better = found
            grad = grad + broyden(grad, moved - numbers, other - predicted)
            little = loss - better < ENOUGH * max(1.0, float(task.observations.sum()))
            numbers, predicted, loss = moved, other, better
        if little and (measured or not renewals):
            break
        age, measured = age + 1, False
        if renewals and (little or age >= LONGEST_LIFE) and number + 1 < steps:
            grad = slopes(task, unknowns, numbers, predicted, every)
            renewals, age, measured = renewals - 1, 0, True
    return Fit(unknowns, numbers, predicted, task.misfit(predicted), grad)


def broyden(grad: np.ndarray, change: np.ndarray, moved: np.ndarray) -> np.ndarray:
    """Return the smallest correction of slopes that explains how the positions moved, shape (size, E, T, n)."""
    missing = moved - np.tensordot(change, grad, 1)
    return np.asarray(change[:, None, None, None] * missing[None] / max(float(change @ change), 1e-12))


def step(
    task: Task, unknowns: Unknowns, numbers: np.ndarray, predicted: np.ndarray, grad: np.ndarray, loss: float
) -> tuple[np.ndarray, np.ndarray, float] | None:
    """Return numbers, positions and loss after one step that lowers the loss, None where none does."""
    low, high = unknowns.bounds()
    weights = task.weights(predicted)
    rows = (grad * weights).reshape(len(grad), -1)
    errors = (task.evidence.errors(predicted) * weights).ravel()
    rows = rows * np.repeat(task.evidence.counts[..., None], predicted.shape[2], -1).ravel()
    square, pull = rows @ rows.T, rows @ errors

    def wanted(prior: np.ndarray, damping: float) -> np.ndarray:
        return constrained(square + np.diag(prior), pull + prior * numbers, damping, low - numbers, high - numbers)

    for damping in DAMPING:
        change = wanted(unknowns.prior(numbers) ** 2, damping)
        change = wanted(unknowns.prior(numbers + change) ** 2, damping)  # which is another where a sign changes
        change *= min(1.0, LONGEST_STEP / max(float(np.abs(change).max()), 1e-12))
        moved = np.clip(numbers + change, low, high)
        other = task.predict(unknowns, moved)
        better = task.misfit(other) + penalty(unknowns, moved)
        if other is not None and better < loss:
            return moved, other, better
    return None


def constrained(square: np.ndarray, pull: np.ndarray, damping: float, low: np.ndarray, high: np.ndarray) -> np.ndarray:
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
