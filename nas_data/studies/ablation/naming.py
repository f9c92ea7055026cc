"""Naming inside a trial: what `nas gap` says is missing in the source, from some transitions alone."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from nas_data.dataset.dataset import Dataset
from nas_data.effects.base import Effect
from nas_data.gap.name import name
from nas_data.gap.named import Named
from nas_data.gap.problem import Problem
from nas_data.gap.side_by_side import on_one_core
from nas_data.robots.base import Robot, find_robot
from nas_data.sources import SourceModel


@dataclass(frozen=True)
class NamedSource:
    """A source with what was named.

    Attributes:
        source: With the effects and the retuned base.
        effects: The effects.
        retuned: Factors of base parameters by name.
    """

    source: SourceModel
    effects: tuple[Effect, ...]
    retuned: Mapping[str, float]

    def to_json(self) -> dict[str, object]:
        """Return what was named."""
        return {"effects": [effect.to_json() for effect in self.effects], "retuned": dict(self.retuned)}


def name_effects(data: Dataset, source: SourceModel, root: Path) -> NamedSource:
    """Name the effects that a source lacks.

    Args:
        data: Transitions; a third of the episodes judges the names.
        source: Without effects of its own.
        root: Folder of the dataset that they are from, for names and errors.

    Raises:
        NasError: the episodes are too few or too short.
    """
    assert not isinstance(source.model, Robot)
    with on_one_core():
        problem = Problem.of(data, source.model, root)
        final = name(problem.train, problem.held).final
    factors = {key: factor for key, factor in final.factors.items() if factor != 1}
    return add(Named(root, tuple(final.effects), factors), source, data)


def read_named(path: Path, source: SourceModel, data: Dataset) -> NamedSource:
    """Take what an earlier gap report named; raises OptionError or JointMismatch where it does not fit."""
    return add(Named.read(path), source, data)


def add(named: Named, source: SourceModel, data: Dataset) -> NamedSource:
    """Return a source with named effects and a retuned base."""
    robot = source.model if isinstance(source.model, Robot) else find_robot(source.model)
    retuned = named.robot(robot, data.joints)
    with_names = replace(source, model=retuned, effects=(*source.effects, *named.effects))
    return NamedSource(with_names, named.effects, named.retuned)
