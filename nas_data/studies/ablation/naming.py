"""Naming of effects inside a trial, from its training transitions alone."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from nas_data.dataset.dataset import Dataset
from nas_data.effects.base import Effect
from nas_data.gap.model_correction import ModelCorrection
from nas_data.gap.name import name
from nas_data.gap.problem import Problem
from nas_data.gap.side_by_side import on_one_core
from nas_data.robots.base import Robot, find_robot
from nas_data.sources import SourceModel


@dataclass(frozen=True)
class NamedSource:
    """A source with named effects.

    Attributes:
        source: The source with effects and changed base parameters.
        effects: The named effects.
        retuned: Factors of base parameters by name.
    """

    source: SourceModel
    effects: tuple[Effect, ...]
    retuned: Mapping[str, float]


def name_effects(data: Dataset, source: SourceModel, root: Path) -> NamedSource:
    """Name the effects that a source lacks.

    Args:
        data: Transitions; a third of the episodes is held out.
        source: Source without effects of its own.
        root: Folder of their dataset, for names and error messages.

    Raises:
        NasError: the episodes are too few or too short.
    """
    assert not isinstance(source.model, Robot)
    with on_one_core():
        problem = Problem.of(data, source.model, root)
        final = name(problem.train, problem.held).final
    factors = {key: factor for key, factor in final.factors.items() if factor != 1}
    return add(ModelCorrection(root, tuple(final.effects), factors), source, data)


def read_named(path: Path, source: SourceModel, data: Dataset) -> NamedSource:
    """Use the effects of an earlier gap report; raises OptionError or JointMismatch if it does not match."""
    return add(ModelCorrection.read(path), source, data)


def add(named: ModelCorrection, source: SourceModel, data: Dataset) -> NamedSource:
    """Return a source with named effects and a retuned base."""
    robot = source.model if isinstance(source.model, Robot) else find_robot(source.model)
    retuned = named.robot(robot, data.joints)
    with_names = replace(source, model=retuned, effects=(*source.effects, *named.effects))
    return NamedSource(with_names, named.effects, named.retuned)
