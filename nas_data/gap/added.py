"""Score a model with its named effects on the held-out episodes, from the written file."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from nas_data.gap.add import write_effects, write_model
from nas_data.gap.nominal import Nominal, with_timestep
from nas_data.gap.problem import Problem
from nas_data.gap.search.final import Final, finish
from nas_data.gap.search.fit import Task
from nas_data.gap.search.scales import scales
from nas_data.simulators.settled import Hold


@dataclass(frozen=True)
class Outcome:
    """What the models do on the held-out episodes: positions [rad], shape (E, T, n).

    Attributes:
        before: Model as handed over.
        retuned: With base parameters fitted, nothing added.
        after: With the named effects: the written model, read back, where MJCF can express them all.
        written: The written model, read back.
        model: Its file.
        learned: Shares of the gap where φ was trained on top, None otherwise.
    """

    before: np.ndarray
    retuned: np.ndarray
    after: np.ndarray
    written: np.ndarray
    model: Path
    learned: Mapping[str, float] | None = None


def added(problem: Problem, final: Final, null: Final, folder: Path) -> Outcome:
    """Write the model and judge it by what the written file does on held-out episodes.

    Where an effect is beyond MJCF, the file holds the nearest one that is not, fitted in its place; the error after
    is then that of the effects named, which `effects.json` holds, and the file's own is told beside it.
    """
    task = replace(problem.train, fine=final.fine).begun(final.effects, dict(final.factors))
    task = task.corrected(final.effects, dict(final.factors))
    hold = usual_hold(task, final)
    nominal, held = problem.held.nominal, problem.held.evidence.begun(hold)
    effects, factors = final.effects, dict(final.factors)
    native = stand_ins(problem, final)
    model, _ = write_model(folder, nominal, native.effects, dict(native.factors), task.timestep)
    write_effects(folder, effects, factors)
    written = Nominal.load(model, held).predict(held)
    after = written
    if native is not final:
        after = with_timestep(nominal, task.timestep).predict(held, effects, factors)
    return Outcome(
        before=nominal.predict(held),
        retuned=nominal.predict(held, (), null.factors),
        after=after,
        written=written,
        model=model,
    )


def usual_hold(task: Task, final: Final) -> Hold:
    """Return whether the weight or nothing loads a model best at the start of all episodes alike."""
    effects, factors = final.effects, dict(final.factors)
    if not task.nominal.simulator(effects, factors).remembers:
        return Hold.WEIGHT

    def misfit(hold: Hold) -> float:
        predicted = task.nominal.predict(task.evidence.begun(hold), effects, factors)
        return task.misfit(predicted + task.correction)

    return min((Hold.WEIGHT, Hold.NOTHING), key=misfit)


def stand_ins(problem: Problem, final: Final) -> Final:
    """Return a hypothesis that a model file can express: the same one, or one with the nearest effects, fitted."""
    if all(effect.in_model for effect in final.effects):
        return final
    train = problem.train
    sizes = scales(train.nominal, train.evidence, train.nominal.predict(train.evidence))
    by_joint = dict(zip(train.nominal.joints, sizes, strict=True))
    near = [effect if effect.joint is None else effect.native(by_joint[effect.joint]) for effect in final.effects]
    return finish(train, [effect for effect in near if effect is not None], dict(final.factors), rounds=1)
