"""Held-out errors of the models, computed from the written file."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from nas_data.effects.base import Effect, Scales
from nas_data.errors import ModelFileError
from nas_data.gap.episode_batch import EpisodeBatch
from nas_data.gap.nominal import Nominal, with_timestep
from nas_data.gap.problem import Problem
from nas_data.gap.report_parts import LearnedCorrection
from nas_data.gap.search.final import FinalFit, fit_final
from nas_data.gap.search.hypothesis import Description
from nas_data.gap.search.objective import FitTask
from nas_data.gap.search.scales import estimate_scales
from nas_data.gap.write_model import MODEL, write_effects, write_model

MAX_ERROR_RATIO = 1.5  # largest ratio of errors of the file over the effects on training episodes, floor included
GOOD_ERROR_RATIO = 1.1  # ratio below which no further size is tried
LONGER_STEP_RATIO = 1.05  # largest ratio of a joint's error, floor included, with longer physics steps

# Multiples of large torque and speed for which effects with hooks are written to a file. Later ones have heavier pads,
# which bounce less: they disturb a saturated servo with velocity feedback less, but follow its torque more slowly.
SIZES = ((1.0, 1.0), (2.0, 1.0), (4.0, 1.0), (8.0, 1.5))


@dataclass(frozen=True)
class Prediction:
    """Prediction of the held-out episodes by one model.

    Attributes:
        positions: Positions from the estimated initial states [rad; m], shape (E, T, n).
        squares: Mean squared errors [rad²; m²], shape (E, n). The initial state of an episode that begins in motion has
            moved within its uncertainty, because its error is not one of the model.
    """

    positions: np.ndarray
    squares: np.ndarray

    @classmethod
    def diverged(cls, evidence: EpisodeBatch) -> "Prediction":
        """Return the prediction of a model that diverges: no positions, infinite errors."""
        return cls(np.full(evidence.measured.shape, np.nan), np.full(evidence.initial_positions.shape, np.inf))

    @property
    def is_finite(self) -> bool:
        """Whether the model does not diverge."""
        return bool(np.isfinite(self.squares).all())


@dataclass(frozen=True)
class HeldOutResult:
    """Predictions of the held-out episodes by the models.

    Attributes:
        before: Given model.
        retuned: Model's own parameters fitted, no effects.
        plain: Plain fit.
        after: Named effects; read back from the written model if MJCF can express them all.
        written: Written model, read back.
        model: Its file.
        expresses_all: Whether the written file expresses every effect.
        delivered: Content of the file: `names`; `names and plain`, with the changes of the plain fit; `names of MJCF
            and plain`, without effects that only `effects.json` expresses; `plain`; or `given`, the given model.
        learned: Errors without and with φ if it was trained, else None.
    """

    before: Prediction
    retuned: Prediction
    plain: Prediction
    after: Prediction
    written: Prediction
    model: Path
    expresses_all: bool = True
    delivered: str = "names"
    learned: LearnedCorrection | None = None

    def contains(self, effect: Effect) -> bool:
        """Whether the written file contains an effect."""
        return self.delivered != "plain" and (self.expresses_all or effect.in_model)


def score_model(problem: Problem, final: FinalFit, null: FinalFit, plain: FinalFit, folder: Path) -> HeldOutResult:
    """Write the model and compute held-out predictions from the file.

    If the file can express all effects, it holds them. Otherwise it holds the most similar effects; `after` is then
    predicted with the effects of `effects.json`, and the file's own error is reported beside it.
    """
    held = problem.held
    nominal, effects, factors = held.nominal, final.effects, dict(final.factors)
    named = with_timestep(nominal, replace(problem.train, fine=final.fine).timestep)
    expresses_all = all(effect.in_model for effect in effects)
    if expresses_all:
        named = lengthen_timestep(problem, final, named)
        write_model(folder, nominal, effects, factors, float(named.spec.option.timestep))
    else:
        expresses_all = write_nearest(problem, final, folder, named)
    written = predict_episodes(held, Nominal.load(folder / MODEL, held.evidence))
    outcome = HeldOutResult(
        before=predict_episodes(held, problem.as_given),
        retuned=predict_episodes(held, nominal, (), null.factors),
        plain=predict_held(problem, plain),
        after=written if expresses_all else predict_episodes(held, named, effects, factors),
        written=written,
        model=folder / MODEL,
        expresses_all=expresses_all,
    )
    write_effects(folder, effects, factors, nominal, outcome.contains)
    return outcome


def lengthen_timestep(problem: Problem, final: FinalFit, named: Nominal) -> Nominal:
    """Return the model with the longest physics steps, at most the given model's, that predict as well as its own.

    Args:
        problem: Recording and model.
        final: Effects and factors.
        named: Model without effects, with the physics steps of the fit.
    """
    own, task = problem.held.nominal, problem.train
    longest = float(own.spec.option.timestep)

    def measure_error(nominal: Nominal) -> np.ndarray:
        try:
            evidence = nominal.infer_initial_loads(task.evidence, final.effects, dict(final.factors))
            predicted = nominal.predict(evidence, final.effects, dict(final.factors))
        except ModelFileError:  # it diverges
            return np.full(len(own.joints), np.inf)
        return np.sqrt((task.floors**2 + evidence.mean_squares(predicted)).mean(0))

    candidates = [step for step in (longest, longest / 2) if step > float(named.spec.option.timestep)]
    reached = measure_error(named) if candidates else np.inf
    for nominal in (with_timestep(own, step) for step in candidates):
        error = measure_error(nominal)
        if np.isfinite(error).all() and (error <= LONGER_STEP_RATIO * reached).all():
            return nominal
    return named


def predict_held(problem: Problem, final: FinalFit) -> Prediction:
    """Return a hypothesis' prediction of the held-out episodes at its timestep."""
    nominal = with_timestep(problem.held.nominal, replace(problem.train, fine=final.fine).timestep)
    return predict_episodes(problem.held, nominal, final.effects, final.factors)


def predict_episodes(
    held: FitTask, nominal: Nominal, effects: Sequence[Effect] = (), factors: Mapping[str, float] | None = None
) -> Prediction:
    """Return the prediction of held-out episodes by a model with effects and factors of its parameters, by name."""
    numbers = dict(factors or {})
    try:
        evidence = nominal.infer_initial_loads(held.evidence, effects, numbers)
        positions = nominal.predict(evidence, effects, numbers)
        if not evidence.begins_in_motion:
            return Prediction(positions, evidence.mean_squares(positions))
        task = replace(held, nominal=nominal, evidence=evidence, coarse_model=None, correction=0.0)
        moved = task.estimate_initial_states(effects, numbers).evidence
        return Prediction(positions, moved.mean_squares(nominal.predict(moved, effects, numbers)))
    except ModelFileError:
        return Prediction.diverged(held.evidence)


def write_nearest(problem: Problem, final: FinalFit, folder: Path, named: Nominal) -> bool:
    """Write the model file most similar to effects with hooks; return whether it is equivalent.

    Args:
        problem: Recording and model.
        final: Effects and factors.
        folder: Output folder.
        named: Model without effects at the timestep to be written.
    """
    floors, factors = problem.train.floors, dict(final.factors)
    fitted = named.infer_initial_loads(problem.train.evidence, final.effects, factors)
    reached = (floors**2 + fitted.mean_squares(named.predict(fitted, final.effects, factors))).mean(0)

    def write(effects: Sequence[Effect], factors: dict[str, float]) -> None:
        write_model(folder, problem.held.nominal, effects, factors, float(named.spec.option.timestep))

    def measure_ratio(effects: Sequence[Effect], factors: dict[str, float]) -> float:
        try:
            write(effects, factors)
            alone = Nominal.load(folder / MODEL, fitted).predict(fitted)
        except ModelFileError:  # it does not compile or diverges
            return np.inf
        return float(np.sqrt((floors**2 + fitted.mean_squares(alone)).mean(0) / reached).max())

    tried: list[tuple[float, Sequence[Effect], dict[str, float]]] = []
    for forms in generate_written_forms(problem, final):
        tried.append((measure_ratio(forms, factors), forms, factors))
        if tried[-1][0] <= min(GOOD_ERROR_RATIO, MAX_ERROR_RATIO):
            return True
    expresses_all = min((entry[0] for entry in tried), default=np.inf) <= MAX_ERROR_RATIO
    if not expresses_all:
        constant = fit_model_effects(problem, final)
        near = constant.effects, dict(constant.factors)
        tried.insert(0, (measure_ratio(*near), *near))  # first, so that it is the default if nothing compiles
    _, effects, factors = min(tried, key=lambda entry: entry[0])
    write(effects, factors)
    return expresses_all


def generate_written_forms(problem: Problem, final: FinalFit) -> Iterator[list[Effect]]:
    """Yield the effects in forms that a file expresses, for several scales; none if one has no such form."""
    sizes = estimate_effect_scales(problem, final)
    for torque, speed in SIZES:
        made = [replace(own, torque=torque * own.torque, speed=speed * own.speed) for own in sizes]
        pairs = zip(final.effects, made, strict=True)
        forms = [effect if effect.joint is None else effect.written_form(own) for effect, own in pairs]
        known = [form for form in forms if form is not None]
        if len(known) == len(forms):
            yield known


def fit_model_effects(problem: Problem, final: FinalFit) -> FinalFit:
    """Fit the most similar effects that MJCF alone expresses."""
    sizes = zip(final.effects, estimate_effect_scales(problem, final), strict=True)
    near = [effect if effect.joint is None else effect.nearest_in_model(own) for effect, own in sizes]
    description = Description(tuple(effect for effect in near if effect is not None))
    return fit_final(problem.train, description, dict(final.factors), rounds=1, intervals=False)


def estimate_effect_scales(problem: Problem, final: FinalFit) -> list[Scales]:
    """Return the scales at each effect's joint; those of the first joint for effects of the whole arm."""
    train = problem.train
    sizes = estimate_scales(train.nominal, train.evidence, train.nominal.predict(train.evidence))
    joints = train.nominal.joints
    return [sizes[joints.index(effect.joint) if effect.joint in joints else 0] for effect in final.effects]
