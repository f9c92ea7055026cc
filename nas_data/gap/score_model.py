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
from nas_data.gap.search.final import FinalFit, fit_final
from nas_data.gap.search.hypothesis import Description
from nas_data.gap.search.objective import FitTask
from nas_data.gap.search.scales import estimate_scales
from nas_data.gap.write_model import MODEL, write_effects, write_model
from nas_data.open_loop import has_setpoints
from nas_data.simulators.initial_states import InitialLoad

AS_GOOD = 1.5  # largest ratio of errors of the file over the effects on training episodes, floor included
CLOSE = 1.1  # ratio below which no further size is tried

# Multiples of large torque and speed for which effects with hooks are written to a file. Later ones have heavier pads,
# which bounce less: they disturb a saturated servo with velocity feedback less, but follow its torque more slowly.
SIZES = ((1.0, 1.0), (2.0, 1.0), (4.0, 1.0), (8.0, 1.5))


@dataclass(frozen=True)
class HeldOutResult:
    """Predictions of the models on the held-out episodes: positions [rad; m], shape (E, T, n).

    Attributes:
        before: Given model.
        retuned: Model's own parameters fitted, no effects.
        plain: Plain fit.
        after: Named effects; read back from the written model if MJCF can express them all.
        written: Written model, read back.
        model: Its file.
        whole: Whether the written file expresses every effect.
        delivered: Content of the file: `names`; `names and plain`, with the changes of the plain fit; `names of MJCF
            and plain`, without effects that only `effects.json` expresses; `plain`; or `given`, the given model.
        learned: Shares of the gap if φ was trained, else None.
    """

    before: np.ndarray
    retuned: np.ndarray
    plain: np.ndarray
    after: np.ndarray
    written: np.ndarray
    model: Path
    whole: bool = True
    delivered: str = "names"
    learned: Mapping[str, float] | None = None


def score_model(problem: Problem, final: FinalFit, null: FinalFit, plain: FinalFit, folder: Path) -> HeldOutResult:
    """Write the model and compute held-out predictions from the file.

    If the file can express all effects, it holds them. Otherwise it holds the most similar effects; `after` is then
    predicted with the effects of `effects.json`, and the file's own error is reported beside it.
    """
    task = replace(problem.train, fine=final.fine)
    nominal, held = problem.held.nominal, assume_initial_loads(problem.held, task, final)
    effects, factors = final.effects, dict(final.factors)
    named = with_timestep(nominal, task.timestep)
    whole = all(effect.in_model for effect in effects)
    if whole:
        write_model(folder, nominal, effects, factors, task.timestep)
    else:
        whole = write_nearest(problem, final, folder, assume_initial_loads(problem.train, task, final), named)
    write_effects(folder, effects, factors, whole, nominal.slides)
    written = Nominal.load(folder / MODEL, held).predict(held)
    return HeldOutResult(
        before=problem.as_given.predict(held),
        retuned=nominal.predict(held, (), null.factors),
        plain=predict_held(problem, plain),
        after=written if whole else named.predict(held, effects, factors),
        written=written,
        model=folder / MODEL,
        whole=whole,
    )


def predict_held(problem: Problem, final: FinalFit) -> np.ndarray:
    """Return a hypothesis' predictions of the held-out episodes at its timestep [rad; m], shape (E, T, n)."""
    task = replace(problem.train, fine=final.fine)
    nominal = with_timestep(problem.held.nominal, task.timestep)
    held = assume_initial_loads(problem.held, task, final)
    return nominal.predict(held, final.effects, dict(final.factors))


def write_nearest(problem: Problem, final: FinalFit, folder: Path, fitted: EpisodeBatch, named: Nominal) -> bool:
    """Write the model file most similar to effects with hooks; return whether it is equivalent.

    Args:
        problem: Recording and model.
        final: Effects and factors.
        folder: Output folder.
        fitted: Training episodes, for the comparison.
        named: Model without effects at the timestep to be written.
    """
    floor, factors = problem.train.floor, dict(final.factors)
    reached = (floor**2 + fitted.mean_squares(named.predict(fitted, final.effects, factors))).mean(0)

    def write(effects: Sequence[Effect], factors: dict[str, float]) -> None:
        write_model(folder, problem.held.nominal, effects, factors, float(named.spec.option.timestep))

    def measure_ratio(effects: Sequence[Effect], factors: dict[str, float]) -> float:
        try:
            write(effects, factors)
            alone = Nominal.load(folder / MODEL, fitted).predict(fitted)
        except ModelFileError:  # it does not compile or diverges
            return np.inf
        return float(np.sqrt((floor**2 + fitted.mean_squares(alone)).mean(0) / reached).max())

    tried: list[tuple[float, Sequence[Effect], dict[str, float]]] = []
    for forms in generate_written_forms(problem, final):
        tried.append((measure_ratio(forms, factors), forms, factors))
        if tried[-1][0] <= min(CLOSE, AS_GOOD):
            return True
    whole = min((entry[0] for entry in tried), default=np.inf) <= AS_GOOD
    if not whole:
        constant = fit_model_effects(problem, final)
        near = constant.effects, dict(constant.factors)
        tried.insert(0, (measure_ratio(*near), *near))  # first, so that it is the default if nothing compiles
    _, effects, factors = min(tried, key=lambda entry: entry[0])
    write(effects, factors)
    return whole


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


def assume_initial_loads(part: FitTask, task: FitTask, final: FinalFit) -> EpisodeBatch:
    """Return the episodes of a part with initial loads that suit a final fit.

    The setpoint of a servo that is commanded a velocity has no start that suits all episodes: each has its own.
    """
    if has_setpoints(task.nominal.simulator()):
        return part.estimate_initial_loads(final.effects, dict(final.factors)).evidence
    return part.evidence.with_initial_loads(choose_initial_load(task, final))


def choose_initial_load(task: FitTask, final: FinalFit) -> InitialLoad:
    """Return the initial load, gravity or none, with the lower misfit over all episodes.

    Only effects with hidden states, such as play, make a difference.
    """
    effects, factors = final.effects, dict(final.factors)
    if not task.nominal.simulator(effects, factors).remembers:
        return InitialLoad.GRAVITY
    task = task.estimate_initial_loads(effects, factors).correct_timestep(effects, factors)

    def misfit(load: InitialLoad) -> float:
        predicted = task.rollout_model.predict(task.evidence.with_initial_loads(load), effects, factors)
        return task.misfit(predicted + task.correction)

    return min((InitialLoad.GRAVITY, InitialLoad.UNLOADED), key=misfit)


def fit_model_effects(problem: Problem, final: FinalFit) -> FinalFit:
    """Fit the most similar effects that MJCF alone expresses."""
    sizes = zip(final.effects, estimate_effect_scales(problem, final), strict=True)
    near = [effect if effect.joint is None else effect.nearest_in_model(own) for effect, own in sizes]
    description = Description(tuple(effect for effect in near if effect is not None))
    return fit_final(problem.train, description, dict(final.factors), rounds=1)


def estimate_effect_scales(problem: Problem, final: FinalFit) -> list[Scales]:
    """Return the scales at each effect's joint; those of the first joint for effects of the whole arm."""
    train = problem.train
    sizes = estimate_scales(train.nominal, train.evidence, train.nominal.predict(train.evidence))
    joints = train.nominal.joints
    return [sizes[joints.index(effect.joint) if effect.joint in joints else 0] for effect in final.effects]
