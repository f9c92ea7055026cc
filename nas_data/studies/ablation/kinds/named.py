"""Named: the source with the effects that `nas gap` names from the subset, without training."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from nas_data.dataset.dataset import Dataset
from nas_data.effects.base import Effect
from nas_data.gap.model_correction import ModelCorrection
from nas_data.gap.name import name
from nas_data.gap.problem import Problem
from nas_data.gap.side_by_side import on_one_core
from nas_data.robots.base import Robot
from nas_data.simulators.servo_registers import ServoRegisters
from nas_data.sources import SourceModel
from nas_data.studies.ablation.kinds.base import ModelKind, TrainedPredictor, TrainingInput


@dataclass(frozen=True)
class NamedSource:
    """A source with named effects."""

    source: SourceModel  # the source with effects and changed base parameters
    effects: tuple[Effect, ...]  # the named effects
    retuned: Mapping[str, float]  # factors of base parameters by name


def name_effects(data: Dataset, source: SourceModel, root: Path) -> NamedSource:
    """Name the effects that a source without effects lacks; a third of the episodes is held out.

    Raises:
        NasError: the episodes are too few or too short.
    """
    assert not isinstance(source.model, Robot)
    with on_one_core():
        problem = Problem.of(data, source.model, root)
        final = name(problem.train, problem.held).final
    factors = {key: factor for key, factor in final.factors.items() if factor != 1}
    return add(ModelCorrection(root, tuple(final.effects), factors, problem.as_given.registers), source, data)


def read_named(path: Path, source: SourceModel, data: Dataset, root: Path) -> NamedSource:
    """Use the effects of an earlier gap report, and the registers of the recording.

    Raises:
        OptionError, JointMismatch: the report does not match.
    """
    found = ModelCorrection.read(path)
    registers = ServoRegisters.of(data, root).over(found.registers)
    return add(replace(found, registers=registers), source, data)


def add(named: ModelCorrection, source: SourceModel, data: Dataset) -> NamedSource:
    """Return a source with named effects and a retuned base."""
    retuned = named.robot(source.robot, data.joints)
    with_names = replace(source, model=retuned, effects=(*source.effects, *named.effects))
    return NamedSource(with_names, named.effects, named.retuned)


def learn(lesson: TrainingInput) -> TrainedPredictor:
    """Name effects, or use the given ones."""
    named = (
        read_named(lesson.effects, lesson.plain, lesson.data, lesson.root)
        if lesson.effects
        else name_effects(lesson.data, lesson.plain, lesson.root)
    )
    return TrainedPredictor(None, named.source, named)


KIND = ModelKind("named", learn, trains=False, needs_source=True, names=True)
