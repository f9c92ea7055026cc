"""Score a model with its named effects on the held-out episodes, from the written file."""

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
from nas_data.simulators.initial_states import InitialLoad

AS_GOOD = 1.5  # error of a joint on training episodes, floor included, up to which a file does what the names do

# Of the large torque and speed, for which a form in a file is made. Where the first does not do, pads that are heavier
# are tried: bouncing less, they take less from a saturated servo with velocity feedback, and follow its torque later.
SIZES = ((1.0, 1.0), (2.0, 1.0), (4.0, 1.0), (8.0, 1.5))


@dataclass(frozen=True)
class HeldOutResult:
    """What the models do on the held-out episodes: positions [rad], shape (E, T, n).

    Attributes:
        before: Model as handed over.
        retuned: With the model's own parameters fitted a few percent, nothing added.
        plain: With every smooth parameter fitted, no name given.
        after: With the named effects: the written model, read back, where MJCF can express them all.
        written: The written model, read back.
        model: Its file.
        whole: Whether the written file holds every effect named.
        delivered: What the written file is: `names`; `names and plain`, with what the plain fit changes besides;
            `plain`; or `given`, the model as handed over.
        learned: Shares of the gap where φ was trained on top, None otherwise.
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
    """Write the model and judge it by what the written file does on held-out episodes.

    Where the file can do without what runs between physics steps, it holds everything. Otherwise it holds what comes
    nearest; the error after is then that of the effects named, which `effects.json` holds, and the file's own is told
    beside it.
    """
    task = replace(problem.train, fine=final.fine).estimate_initial_loads(final.effects, dict(final.factors))
    task = task.correct_timestep(final.effects, dict(final.factors))
    hold = usual_hold(task, final)
    nominal, held = problem.held.nominal, problem.held.evidence.with_initial_loads(hold)
    effects, factors = final.effects, dict(final.factors)
    named = with_timestep(nominal, task.timestep)
    whole = all(effect.in_model for effect in effects)
    if whole:
        write_model(folder, nominal, effects, factors, task.timestep)
    else:
        whole = write_nearest(problem, final, folder, problem.train.evidence.with_initial_loads(hold), named)
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
    """Return what a hypothesis predicts of the held-out episodes, at its physics step [rad], shape (E, T, n)."""
    task = replace(problem.train, fine=final.fine)
    nominal = with_timestep(problem.held.nominal, task.timestep)
    held = problem.held.evidence.with_initial_loads(usual_hold(task, final))
    return nominal.predict(held, final.effects, dict(final.factors))


def write_nearest(problem: Problem, final: FinalFit, folder: Path, fitted: EpisodeBatch, named: Nominal) -> bool:
    """Write the model file that comes nearest to effects with hooks; return whether it does what they do.

    Args:
        problem: What was given.
        final: The effects and factors.
        folder: Where.
        fitted: Training episodes, by which that is judged.
        named: The model at the physics step to be written, without effects.
    """
    floor, factors = problem.train.floor, dict(final.factors)
    enough = AS_GOOD**2 * (floor**2 + fitted.mean_squares(named.predict(fitted, final.effects, factors))).mean(0)

    def write(effects: Sequence[Effect], factors: dict[str, float]) -> None:
        write_model(folder, problem.held.nominal, effects, factors, float(named.spec.option.timestep))

    def excess(effects: Sequence[Effect], factors: dict[str, float]) -> float:
        try:
            write(effects, factors)
            alone = Nominal.load(folder / MODEL, fitted).predict(fitted)
        except ModelFileError:  # it does not compile or diverges
            return np.inf
        return float(((floor**2 + fitted.mean_squares(alone)).mean(0) / enough).max())

    tried: list[tuple[float, Sequence[Effect], dict[str, float]]] = []
    for forms in written_forms(problem, final):
        tried.append((excess(forms, factors), forms, factors))
        if tried[-1][0] <= 1:
            return True
    constant = stand_ins(problem, final)
    near = constant.effects, dict(constant.factors)
    tried.insert(0, (excess(*near), *near))  # first: it is taken where nothing compiles
    _, effects, factors = min(tried, key=lambda entry: entry[0])
    write(effects, factors)
    return False


def written_forms(problem: Problem, final: FinalFit) -> Iterator[list[Effect]]:
    """Yield the effects as a file can hold them, made for several sizes; nothing where it cannot hold one of them."""
    sizes = scales_of_effects(problem, final)
    for torque, speed in SIZES:
        made = [replace(own, torque=torque * own.torque, speed=speed * own.speed) for own in sizes]
        pairs = zip(final.effects, made, strict=True)
        forms = [effect if effect.joint is None else effect.written_form(own) for effect, own in pairs]
        known = [form for form in forms if form is not None]
        if len(known) == len(forms):
            yield known


def usual_hold(task: FitTask, final: FinalFit) -> InitialLoad:
    """Return whether the weight or nothing loads a model best at the start of all episodes alike."""
    effects, factors = final.effects, dict(final.factors)
    if not task.nominal.simulator(effects, factors).remembers:
        return InitialLoad.GRAVITY

    def misfit(hold: InitialLoad) -> float:
        predicted = task.rollout_model.predict(task.evidence.with_initial_loads(hold), effects, factors)
        return task.misfit(predicted + task.correction)

    return min((InitialLoad.GRAVITY, InitialLoad.UNLOADED), key=misfit)


def stand_ins(problem: Problem, final: FinalFit) -> FinalFit:
    """Return a hypothesis of effects that edits alone express: the nearest to those named, fitted."""
    sizes = zip(final.effects, scales_of_effects(problem, final), strict=True)
    near = [effect if effect.joint is None else effect.nearest_in_model(own) for effect, own in sizes]
    description = Description(tuple(effect for effect in near if effect is not None))
    return fit_final(problem.train, description, dict(final.factors), rounds=1)


def scales_of_effects(problem: Problem, final: FinalFit) -> list[Scales]:
    """Return what is big and small at the joint of each effect; at the first joint for those of the whole arm."""
    train = problem.train
    sizes = estimate_scales(train.nominal, train.evidence, train.nominal.predict(train.evidence))
    joints = train.nominal.joints
    return [sizes[joints.index(effect.joint) if effect.joint in joints else 0] for effect in final.effects]
