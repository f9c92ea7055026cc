"""What is minimised: the misfit of open-loop rollouts, at one tolerance, and scores that know which one they are of."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import count

import numpy as np

from nas_data.effects.base import Effect
from nas_data.errors import ModelFileError
from nas_data.gap.episode_batch import EpisodeBatch
from nas_data.gap.integrator import whole_step
from nas_data.gap.nominal import Nominal, fine_timestep, with_timestep
from nas_data.gap.search.parameters import FreeParameters
from nas_data.simulators.initial_states import InitialLoad

BEGINNING = 1.0  # [s] by which the start of an episode is told
FAMILIAR = 0.8  # mean square of the likeliest start that counts as equal to another's
COARSE = 0.1  # part of a joint's error that does not matter before the rest is explained
CORRELATION = 0.15  # [s] over which errors of a rollout are alike: so many rows count as one observation
MULTIPLES = (4, 2)  # of the model's own physics step, tried in this order for the rollouts of a search
LONGER = 0.5  # part of each joint's error below which longer steps must stay to be taken
FURTHEST = 3.0  # standard deviations by which an initial velocity may be moved

OBJECTIVES = count()

Reach = Mapping[str | None, np.ndarray]  # which joints something moves, shape (n,), by its name


class ObjectiveMismatch(AssertionError):
    """Two losses of different objectives were compared."""


@dataclass(frozen=True)
class Score:
    """A loss, or a loss and what its hypothesis costs, in nats; less is better.

    Attributes:
        nats: The value.
        objective: The objective that it belongs to; only scores of one objective are compared.
    """

    nats: float
    objective: int

    def __add__(self, nats: float) -> "Score":
        """Return a score that is some nats worse."""
        return Score(self.nats + nats, self.objective)

    def over(self, other: "Score") -> float:
        """Return by how many nats this is worse than another.

        Raises:
            ObjectiveMismatch: they belong to different objectives.
        """
        if self.objective != other.objective:
            raise ObjectiveMismatch(f"scores of the objectives {self.objective} and {other.objective} were compared")
        return self.nats - other.nats

    def __lt__(self, other: "Score") -> bool:
        return self.over(other) < 0

    def __gt__(self, other: "Score") -> bool:
        return self.over(other) > 0

    def __le__(self, other: "Score") -> bool:
        return self.over(other) <= 0

    def __ge__(self, other: "Score") -> bool:
        return self.over(other) >= 0


@dataclass(frozen=True)
class FitTask:
    """What is fitted to what.

    Attributes:
        nominal: Model.
        evidence: Episodes.
        floor: Noise floor of each joint [rad], shape (n,).
        correction: What the physics steps of the recording would change in the positions [rad], shape (E, T, n), or 0.
        coarse: The model with the longer physics steps of its rollouts; None where they are its own.
        fine: Whether the recording obeys finer physics steps than the model's own.
        coarseness: Errors of each joint that do not matter yet, while larger ones are explained [rad], shape (n,).
        reach: Which joints parameters of the model move as long as they are bound, where that is known.
        reach_of_joints: Which joints effects and freed parameters move, by their joint, where that is known.
        objective: Which objective this is; losses are compared within one alone. Episodes and tolerance make another.
    """

    nominal: Nominal
    evidence: EpisodeBatch
    floor: np.ndarray
    correction: np.ndarray | float = 0.0
    coarse: Nominal | None = field(default=None, compare=False)
    coarseness: np.ndarray | float = 0.0
    fine: bool = True
    reach: Reach = field(default_factory=dict, compare=False)
    reach_of_joints: Reach = field(default_factory=dict, compare=False)
    objective: int = field(default_factory=lambda: next(OBJECTIVES), compare=False)

    def select(self, episodes: Sequence[int] | np.ndarray) -> "FitTask":
        """Return the task on some of the episodes."""
        correction = self.correction if isinstance(self.correction, float) else self.correction[list(episodes)]
        chosen = self.evidence.select(episodes)
        return replace(self, evidence=chosen, correction=correction).renewed()

    def at_tolerance_of(self, other: "FitTask") -> "FitTask":
        """Return the task with the tolerance and the objective of another, to which its misfit is added."""
        return replace(self, coarseness=other.coarseness, objective=other.objective)

    def renewed(self) -> "FitTask":
        """Return the task as an objective of its own: what is added to its misfit changes."""
        return replace(self, objective=next(OBJECTIVES))

    @property
    def tolerated(self) -> np.ndarray:
        """Mean square of each joint's errors below which all are alike [rad²], shape (n,)."""
        return np.asarray(self.floor**2 + self.coarseness**2)

    def relinearise(self, parameters: FreeParameters, theta: np.ndarray) -> "FitTask":
        """Return the task with initial states, timestep correction and tolerance estimated anew at a hypothesis.

        A tenth of the error that is left does not matter yet. Where a joint stands still, a model may be wrong by a
        tenth of a degree or a hundredth: as long as it is wrong by degrees where the joint moves, that is no reason
        to prefer one cause to another.
        """
        task = self.restart(parameters, theta)
        predicted = task.predict(parameters, theta)
        if predicted is None:
            return task
        return replace(task, coarseness=COARSE * np.sqrt(task.evidence.mean_squares(predicted).mean(0)))

    def restart(self, parameters: FreeParameters, theta: np.ndarray) -> "FitTask":
        """Return the task with initial states and timestep correction estimated anew, as an objective of its own."""
        effects, factors = parameters.effects_at(theta), parameters.factors_at(theta)
        task = self.with_initial_load(effects, factors).with_initial_velocity(effects, factors)
        return task.corrected(effects, factors).renewed()

    def with_initial_load(self, effects: Sequence[Effect], factors: dict[str, float]) -> "FitTask":
        """Return the task with what best explains how each joint of each episode began.

        Whether friction held a part of the weight, and on which side a play lay, is measured by nobody; where a
        hypothesis has such hidden states, they are told by the first second.
        """
        evidence = self.evidence
        early = evidence.first(max(1, round(BEGINNING / evidence.period)))
        try:
            if not self.nominal.simulator(effects, factors).remembers:
                return replace(self, evidence=evidence.begun(InitialLoad.GRAVITY))
            rolled = [self.rolled.predict(early.begun(hold), effects, factors) for hold in InitialLoad]
        except ModelFileError:
            return self
        squares = np.stack([early.mean_squares(predicted) for predicted in rolled]) + self.floor**2
        squares[InitialLoad.GRAVITY] *= FAMILIAR
        return replace(self, evidence=evidence.begun(squares.argmin(0)))

    def with_initial_velocity(self, effects: Sequence[Effect], factors: dict[str, float]) -> "FitTask":
        """Return the task with initial velocities moved, within their uncertainty, towards what explains the motion.

        One Gauss-Newton step of v₀ on ½ Σ w² e² + ½ Σ ((v₀ − v̂₀) / σ)² for each episode by itself; it counts in those
        where it lowers that sum. Episodes that begin at rest stay at rest.
        """
        told = replace(self.evidence, initial_velocities=self.evidence.estimated_velocities)
        moving = np.flatnonzero((told.velocity_deviations > 0).any(axis=1))
        if not len(moving):
            return replace(self, evidence=told)
        part = told.select(moving)
        try:
            predicted = self.rolled.predict(part, effects, factors)
            slopes = np.zeros((len(part.joints), *predicted.shape))
            for joint in range(len(part.joints)):
                if (part.velocity_deviations[:, joint] > 0).any():
                    shift = np.zeros(part.initial_velocities.shape)
                    shift[:, joint] = np.maximum(part.velocity_deviations[:, joint], 1e-6)
                    other = self.rolled.predict(
                        replace(part, initial_velocities=part.initial_velocities + shift), effects, factors
                    )
                    slopes[joint] = (other - predicted) / shift[:, joint][:, None, None]
            weights = self.weights(predicted, part)
            step = velocity_steps(part.errors(predicted) * weights, slopes * weights, part.velocity_deviations)
            moved = replace(part, initial_velocities=part.initial_velocities + step)
            reached = self.rolled.predict(moved, effects, factors)
        except ModelFileError:
            return replace(self, evidence=told)
        cost = ((part.errors(predicted) * weights) ** 2).sum((1, 2))
        prior = ((step / np.where(part.velocity_deviations > 0, part.velocity_deviations, np.inf)) ** 2).sum(1)
        better = ((part.errors(reached) * weights) ** 2).sum((1, 2)) + prior < cost
        speeds = told.initial_velocities.copy()
        speeds[moving] += np.where(better[:, None], step, 0.0)
        return replace(self, evidence=replace(told, initial_velocities=speeds))

    def corrected(self, effects: Sequence[Effect], factors: dict[str, float]) -> "FitTask":
        """Return the task with its rollouts' physics steps, and what the recording's would change at a hypothesis.

        A model's own timestep delays it by about half a step, more than the noise shows. Simulating everything in
        fine steps would cost four times as much; the difference hardly depends on the parameters. Where a hypothesis is
        still far off, longer steps than the model's own tell as much.
        """
        own, small = self.nominal, with_timestep(self.nominal, self.timestep)
        if own.spec.option.timestep == small.spec.option.timestep:
            return self.at_own_steps()
        try:
            rough, finer = (each.predict(self.evidence, effects, factors) for each in (own, small))
            coarse = self.lengthened(rough, finer)
            if coarse is not None:
                rough = coarse.predict(self.evidence, effects, factors)
        except ModelFileError:
            return self.at_own_steps()
        return replace(self, correction=finer - rough, coarse=coarse)

    def lengthened(self, rough: np.ndarray, finer: np.ndarray) -> Nominal | None:
        """Return the model with longer physics steps, where what they change is well below the errors; else None.

        A step of first order changes the positions in proportion to its length.
        """
        own, small = float(self.nominal.spec.option.timestep), self.timestep
        change = np.sqrt(self.evidence.mean_squares(self.evidence.measured + rough - finer).mean(0))
        left = LONGER * np.sqrt(self.evidence.mean_squares(finer).mean(0))
        for multiple in MULTIPLES:
            step = whole_step(self.nominal.period, multiple * own)
            if step > own and (change * (step - small) < left * (own - small)).all():
                return with_timestep(self.nominal, step)
        return None

    def at_own_steps(self) -> "FitTask":
        """Return the task with rollouts in the model's own physics steps, uncorrected."""
        return replace(self, correction=0.0, coarse=None)

    @property
    def rolled(self) -> Nominal:
        """The model that rollouts are made with."""
        return self.coarse or self.nominal

    def at_timestep(self, fine: bool, effects: Sequence[Effect], factors: dict[str, float]) -> "FitTask":
        """Return the task for finer physics steps than the model's own or for its own; of the same objective."""
        return replace(self, fine=fine).corrected(effects, factors)

    @property
    def timestep(self) -> float:
        """The physics step for which the predictions stand [s]."""
        return fine_timestep(self.nominal) if self.fine else float(self.nominal.spec.option.timestep)

    def predict(self, parameters: FreeParameters, theta: np.ndarray) -> np.ndarray | None:
        """Return positions (E, T, n) for fitted numbers, None where the model diverges."""
        try:
            effects, factors = parameters.effects_at(theta), parameters.factors_at(theta)
            return self.rolled.predict(self.evidence, effects, factors) + self.correction
        except ModelFileError:
            return None

    @property
    def observations(self) -> np.ndarray:
        """How many independent observations an episode is worth, shape (E, 1)."""
        return np.asarray(self.evidence.mask.sum(1)[:, None] * self.evidence.period / CORRELATION)

    def misfit(self, predicted: np.ndarray | None) -> float:
        """Return half the log of the mean squared error, summed over episodes and joints, each by its observations.

        It is the likelihood of errors whose size differs by episode and joint: no episode that went astray, and no
        joint with an effect still unnamed, rules the others.
        """
        return np.inf if predicted is None else float(self.misfits(predicted).sum())

    def misfits(self, predicted: np.ndarray) -> np.ndarray:
        """Return the part of each episode and joint in the misfit [nats], shape (E, n)."""
        squares = self.evidence.mean_squares(predicted)
        return np.asarray(0.5 * self.observations * np.log(self.tolerated + squares))

    def weights(self, predicted: np.ndarray, evidence: EpisodeBatch | None = None) -> np.ndarray:
        """Return the weight of each error in the least squares that the misfit amounts to, shape (E, 1, n).

        Args:
            predicted: Positions [rad], shape (E, T, n).
            evidence: Their episodes; the task's where None.
        """
        squares = (evidence or self.evidence).mean_squares(predicted)
        share = self.evidence.period / CORRELATION
        return np.asarray(np.sqrt(share / (self.tolerated + squares)))[:, None]


def velocity_steps(errors: np.ndarray, slopes: np.ndarray, doubts: np.ndarray) -> np.ndarray:
    """Return the changes of the initial velocities that explain weighted errors best, shape (E, n).

    Args:
        errors: Weighted errors, shape (E, T, n).
        slopes: Weighted changes of the positions per velocity, shape (n, E, T, n).
        doubts: Standard deviations of the velocities [rad/s], shape (E, n); 0 where one is certain.
    """
    step = np.zeros(doubts.shape)
    for episode, doubt in enumerate(doubts):
        free = np.flatnonzero(doubt > 0)
        if len(free):
            rows = slopes[free, episode].reshape(len(free), -1) * doubt[free][:, None]
            scaled = np.linalg.solve(rows @ rows.T + np.eye(len(free)), -rows @ errors[episode].ravel())
            step[episode, free] = doubt[free] * np.clip(scaled, -FURTHEST, FURTHEST)
    return step
