"""Objective: misfit of open-loop rollouts at a tolerance."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import count

import numpy as np

from nas_data.effects.base import Effect
from nas_data.errors import ModelFileError
from nas_data.gap.episode_batch import EpisodeBatch
from nas_data.gap.integrator import find_longest_step, find_whole_step
from nas_data.gap.nominal import Nominal, find_fine_timestep, with_timestep
from nas_data.gap.nominal_parameters import scale_base_parameters
from nas_data.gap.search.constants import CORRELATION, ERROR_SHARE, GAIN_SHARE, MAX_ROUNDS, PRICE
from nas_data.gap.search.initial_states import MAX_START_CHANGE, StartResponse, measure_prior
from nas_data.gap.search.parameters import FreeParameters

MULTIPLES = (4, 2)  # multiples of the model's timestep for rollouts of a search, tried in this order

OBJECTIVES = count()  # numbers of objectives

MovedJoints = Mapping[str | None, np.ndarray]  # which joints move, shape (n,), by parameter or joint


@dataclass(frozen=True)
class FitTask:
    """Model and episodes of a fit, with the objective.

    Attributes:
        nominal: Model.
        evidence: Episodes.
        floor: Noise floor of each joint [rad; m], shape (n,).
        correction: Timestep correction of the positions [rad; m], shape (E, T, n), or 0.
        coarse_model: Model with a longer timestep for rollouts; None for the model's own.
        fine: Whether the recording is assumed to have finer physics steps than the model.
        tolerated_error: Part of the tolerance beyond the noise floor [rad; m], shape (n,).
        usual_error: Error of the model without the change that is to be named [rad; m], shape (E, n), or 0.
        moved_by_base: Joints that bounded base parameters move, by parameter, if known.
        moved_by_joint: Joints that effects and freed parameters move, by their joint, if known.
        start_response: Response to the initial states; None if all are certain, or none was measured.
        row_weights: Weights of the errors, shape (E, T, n), or 1; see `weigh_rows`.
        objective: Number of the objective; episodes and tolerance define another one.
    """

    nominal: Nominal
    evidence: EpisodeBatch
    floor: np.ndarray
    correction: np.ndarray | float = 0.0
    coarse_model: Nominal | None = field(default=None, compare=False)
    tolerated_error: np.ndarray | float = 0.0
    usual_error: np.ndarray | float = 0.0
    fine: bool = True
    moved_by_base: MovedJoints = field(default_factory=dict, compare=False)
    moved_by_joint: MovedJoints = field(default_factory=dict, compare=False)
    start_response: StartResponse | None = field(default=None, compare=False)
    row_weights: np.ndarray | float = field(default=1.0, compare=False)
    objective: int = field(default_factory=lambda: next(OBJECTIVES), compare=False)

    def select(self, episodes: Sequence[int] | np.ndarray) -> "FitTask":
        """Return the task with some of its episodes."""
        chosen = list(episodes)
        correction, weights, usual = (
            rows if isinstance(rows, float) else rows[chosen]
            for rows in (self.correction, self.row_weights, self.usual_error)
        )
        response = self.start_response and self.start_response.select(chosen)
        part = replace(self, evidence=self.evidence.select(chosen), correction=correction, start_response=response)
        return replace(part, row_weights=weights, usual_error=usual).with_new_objective()

    def with_tolerance_of(self, other: "FitTask") -> "FitTask":
        """Return the task with tolerance and objective of another, so that their misfits can be added."""
        return replace(self, tolerated_error=other.tolerated_error, objective=other.objective)

    def with_new_objective(self) -> "FitTask":
        """Return the task with a new objective number."""
        return replace(self, objective=next(OBJECTIVES))

    def with_firm_friction(self, firm: Mapping[str, float]) -> "FitTask":
        """Return the task with a model whose friction is firm in some joints, as a new objective.

        Args:
            firm: Factors of `JOINT.solimpfriction`.
        """
        nominal, coarse = (
            model and model.with_edit(lambda spec: scale_base_parameters(spec, (), firm))
            for model in (self.nominal, self.coarse_model)
        )
        assert nominal is not None
        return replace(self, nominal=nominal, coarse_model=coarse).with_new_objective()

    @property
    def has_unpredictable_rows(self) -> bool:
        """Whether some rows have little weight, because their motion cannot be predicted."""
        return bool(np.any(np.less(self.row_weights, 1.0)))

    @property
    def floors(self) -> np.ndarray:
        """Noise floor of each joint, usual error included [rad; m], by episode, shape (E, n)."""
        shape = len(self.evidence), len(self.floor)
        return np.asarray(np.broadcast_to(np.sqrt(self.floor**2 + self.usual_error**2), shape))

    @property
    def mean_floor(self) -> np.ndarray:
        """Root mean square over episodes of `floors` [rad; m], shape (n,)."""
        return np.asarray(np.sqrt((self.floors**2).mean(axis=0)))

    @property
    def tolerance(self) -> np.ndarray:
        """Tolerance τ² of each joint's mean squared error [rad²; m²], by episode, shape (E, n)."""
        return np.asarray(self.floors**2 + self.tolerated_error**2)

    def relinearise(self, parameters: FreeParameters, theta: np.ndarray) -> "FitTask":
        """Return the task with initial states, timestep correction and tolerance estimated at a hypothesis.

        The tolerance includes a tenth of the present error. Otherwise small errors of joints at rest would decide
        between causes while errors in motion are large.
        """
        task = self.reestimate(parameters, theta)
        predicted = task.predict(parameters, theta)
        if predicted is None:
            return task
        return replace(task, tolerated_error=ERROR_SHARE * np.sqrt(task.mean_squares(predicted).mean(0)))

    def settle(self) -> "FitTask":
        """Return the task with initial states and timestep correction estimated for the model as given."""
        return self.reestimate(FreeParameters((), ()), np.zeros(0))

    def reestimate(self, parameters: FreeParameters, theta: np.ndarray) -> "FitTask":
        """Return the task with initial states and timestep correction estimated anew, as a new objective."""
        effects, factors = parameters.effects_at(theta), parameters.factors_at(theta)
        task = self.infer_initial_loads(effects, factors).estimate_initial_states(effects, factors)
        return task.correct_timestep(effects, factors).with_new_objective()

    def infer_initial_loads(self, effects: Sequence[Effect], factors: dict[str, float]) -> "FitTask":
        """Return the task with initial loads inferred for a hypothesis; see `Nominal.infer_initial_loads`."""
        try:
            return replace(self, evidence=self.rollout_model.infer_initial_loads(self.evidence, effects, factors))
        except ModelFileError:
            return self

    def estimate_initial_states(self, effects: Sequence[Effect], factors: dict[str, float]) -> "FitTask":
        """Return the task with initial states moved, within their uncertainty, towards the motion.

        Each episode that begins in motion takes Gauss-Newton steps of its initial state x on ½ Σ w² e² + ½ Σ ((x − x̂)
        / σ)². A step is kept if it lowers misfit plus prior; there are more while this gains as much as the price of an
        effect. The response to the initial states is kept, with which other hypotheses have their own.
        """
        task = replace(self, evidence=self.evidence.with_start_changes(0.0), start_response=None)
        if not task.evidence.begins_in_motion:
            return task
        given = task
        try:
            for _ in range(MAX_ROUNDS):
                task, gained = task.step_initial_states(effects, factors)
                if gained < PRICE:
                    break
        except ModelFileError:
            return given
        return task

    def step_initial_states(self, effects: Sequence[Effect], factors: dict[str, float]) -> tuple["FitTask", float]:
        """Return the task after one step of the initial states, with their response, and what it gained [nats]."""
        alone = replace(self, start_response=None)
        part = self.evidence
        deviations, before = part.start_deviations, part.start_changes
        predicted = self.roll_out(part, effects, factors)
        jacobian = np.zeros((deviations.shape[1], *predicted.shape))
        for column in np.flatnonzero((deviations > 0).any(axis=0)):
            shift = np.zeros(deviations.shape)
            shift[:, column] = np.maximum(deviations[:, column], 1e-6)
            change = self.roll_out(part.with_start_changes(before + shift), effects, factors) - predicted
            jacobian[column] = change / shift[:, column][:, None, None] * part.mask[..., None]
        response = StartResponse(jacobian, alone.weights(predicted), before, deviations)
        _, scaled = response.absorb(part.errors(predicted))
        after = deviations * np.clip(scaled, -MAX_START_CHANGE, MAX_START_CHANGE)
        reached = self.roll_out(part.with_start_changes(after), effects, factors)
        gains = (alone.misfits(predicted) - alone.misfits(reached)).sum(1)
        gains += measure_prior(before, deviations) - measure_prior(after, deviations)
        changes = np.where(gains[:, None] > 0, after, before)
        weights = alone.weights(np.where((gains > 0)[:, None, None], reached, predicted))
        response = replace(response, weights=weights, changes=changes)
        moved = replace(self, evidence=part.with_start_changes(changes), start_response=response)
        return moved, float(np.maximum(gains, 0.0).sum())

    def correct_timestep(self, effects: Sequence[Effect], factors: dict[str, float]) -> "FitTask":
        """Return the task with a timestep correction at a hypothesis, and a longer timestep if errors are large.

        The correction is rollouts in the recording's physics steps minus those of the search. It hardly depends on the
        parameters. Fine steps throughout would take four times as long. The correction matters because a model's
        timestep delays it by about half a step, which exceeds the noise.
        """
        own, small = self.nominal, with_timestep(self.nominal, self.timestep)
        try:
            target = small.predict(self.evidence, effects, factors)
            if coarse := self.choose_coarse_model(target, effects, factors):
                model, rough = coarse
                return replace(self, correction=target - rough, coarse_model=model)
            if own.spec.option.timestep == small.spec.option.timestep:
                return self.with_own_timestep()
            rough = own.predict(self.evidence, effects, factors)
        except ModelFileError:
            return self.with_own_timestep()
        return replace(self, correction=target - rough, coarse_model=None)

    def choose_coarse_model(
        self, target: np.ndarray, effects: Sequence[Effect], factors: dict[str, float]
    ) -> tuple[Nominal, np.ndarray] | None:
        """Return the model with a longer timestep that changes every joint's rollouts much less than their errors.

        Args:
            target: Positions at the recording's physics steps [rad; m], shape (E, T, n).
            effects: Effects of the hypothesis.
            factors: Factors of the model's parameters, by name.

        Returns:
            The model and its positions [rad; m], shape (E, T, n); None if no longer timestep is good enough.
        """
        own, errors = float(self.nominal.spec.option.timestep), self.evidence.mean_squares(target).mean(0)
        longest = find_longest_step(self.nominal.spec.compile())
        for multiple in MULTIPLES:
            step = find_whole_step(self.nominal.period, multiple * own)
            if own < step <= longest:
                coarse = with_timestep(self.nominal, step)
                try:
                    predicted = coarse.predict(self.evidence, effects, factors)
                except ModelFileError:
                    continue
                changes = self.evidence.mean_squares(self.evidence.measured + predicted - target).mean(0)
                if (changes < GAIN_SHARE**2 * errors).all():
                    return coarse, predicted
        return None

    def with_own_timestep(self) -> "FitTask":
        """Return the task with rollouts at the model's own timestep, uncorrected."""
        return replace(self, correction=0.0, coarse_model=None)

    @property
    def rollout_model(self) -> Nominal:
        """Model of the rollouts."""
        return self.coarse_model or self.nominal

    def switch_timestep(self, fine: bool, effects: Sequence[Effect], factors: dict[str, float]) -> "FitTask":
        """Return the task for finer physics steps or the model's own, with the same objective."""
        return replace(self, fine=fine).correct_timestep(effects, factors)

    @property
    def timestep(self) -> float:
        """Physics timestep of the predictions, correction included [s]."""
        return find_fine_timestep(self.nominal) if self.fine else float(self.nominal.spec.option.timestep)

    def predict(self, parameters: FreeParameters, theta: np.ndarray) -> np.ndarray | None:
        """Return predicted positions at θ [rad; m], shape (E, T, n); None if the model diverges."""
        try:
            return self.roll_out(self.evidence, parameters.effects_at(theta), parameters.factors_at(theta))
        except ModelFileError:
            return None

    def roll_out(self, evidence: EpisodeBatch, effects: Sequence[Effect], factors: dict[str, float]) -> np.ndarray:
        """Return the corrected positions of the task's episodes, with any initial states, shape (E, T, n) [rad; m]."""
        return self.rollout_model.predict(evidence, effects, factors) + self.correction

    @property
    def observations(self) -> np.ndarray:
        """Number of independent observations of each episode, shape (E, 1)."""
        return np.asarray(self.evidence.mask.sum(1)[:, None] * self.evidence.period / CORRELATION)

    def misfit(self, predicted: np.ndarray | None) -> float:
        """Return ½ N log(τ² + s), summed over episodes and joints [nats]; infinite without predictions.

        This is the likelihood of errors whose variance differs by episode and joint. Large errors of one episode or
        joint therefore do not dominate.
        """
        if predicted is None:
            return np.inf
        _, deviations = self.errors(predicted)
        return float(self.misfits(predicted).sum() + 0.5 * (deviations**2).sum())

    def misfits(self, predicted: np.ndarray) -> np.ndarray:
        """Return the misfit of each episode and joint, without the prior of initial states [nats], shape (E, n)."""
        return self.compute_misfits(self.mean_squares(predicted))

    def compute_misfits(self, squares: np.ndarray) -> np.ndarray:
        """Return the misfit [nats] of mean squared errors [rad²; m²], shape (E, n) each."""
        return np.asarray(0.5 * self.observations * np.log(self.tolerance + squares))

    def errors(self, predicted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return weighted errors from the most likely initial states, to first order; see `StartResponse.absorb`.

        Args:
            predicted: Positions from the task's initial states [rad; m], shape (E, T, n).

        Returns:
            Errors [rad; m], shape (E, T, n), and initial states over their standard deviations, shape (E, c).
        """
        errors = self.evidence.errors(predicted)
        if self.start_response is None:
            return errors * self.row_weights, np.zeros((len(errors), 0))
        errors, deviations = self.start_response.absorb(errors)
        return errors * self.row_weights, deviations

    def absorb_change(self, change: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return what a change of the positions, shape (…, E, T, n), changes in both results of `errors`."""
        change = change * self.evidence.mask[..., None]
        if self.start_response is None:
            return change * self.row_weights, np.zeros((*change.shape[:-2], 0))
        change, deviations = self.start_response.absorb_change(change)
        return change * self.row_weights, deviations

    def mean_squares(self, predicted: np.ndarray) -> np.ndarray:
        """Return the mean squared error of each episode and joint [rad²; m²], shape (E, n); see `errors`."""
        errors, _ = self.errors(predicted)
        return np.asarray((errors**2).sum(1) / self.evidence.mask.sum(1)[:, None])

    def weights(self, predicted: np.ndarray) -> np.ndarray:
        """Return the weight of each error in the equivalent least squares, shape (E, 1, n).

        Args:
            predicted: Positions [rad; m], shape (E, T, n).
        """
        squares = self.mean_squares(predicted)
        share = self.evidence.period / CORRELATION
        return np.asarray(np.sqrt(share / (self.tolerance + squares)))[:, None]
