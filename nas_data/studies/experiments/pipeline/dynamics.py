"""Descriptions of dynamics, generated from their definitions in `envs/`."""

from functools import partial

from nas_data.effects.base import Effect
from nas_data.envs.base import SOURCE, Task
from nas_data.robots.base import ConsecutiveEdits, Edit
from nas_data.simulators.engines import ENGINE_NAMES
from nas_data.studies.experiments.pipeline.artifacts import Artifacts


def describe_target(material: Artifacts) -> str:
    """Return a sentence on the target of the artifacts."""
    plan = material.plan
    said = describe_dynamics(plan.task, plan.recipe.dynamics, plan.source)
    if plan.recipe.engine == "mujoco":
        return said
    return f"{said} The target is computed by {ENGINE_NAMES[plan.recipe.engine]}, the source by MuJoCo."


def describe_dynamics(task: Task, dynamics: str, source: str = SOURCE) -> str:
    """Return a sentence on what a dynamics and its source add to the plain model.

    Raises:
        UnknownName: the task has no such dynamics; lists those it has.
    """
    said = f"'{dynamics}' is the plain model with {list_effects(task, dynamics)}."
    return (
        said
        if source == SOURCE
        else f"{said} Its source '{source}' is the plain model with {list_effects(task, source)}."
    )


def list_effects(task: Task, dynamics: str) -> str:
    """Return the effects of a dynamics with their joints, and its model edits."""
    joints: dict[str, list[str]] = {}
    for effect in task.effects(dynamics):
        joints.setdefault(format_effect(effect), []).append(effect.joint or "the arm")
    said = [f"{words} in {', '.join(places)}" for words, places in joints.items()]
    return "; ".join([*said, *format_edit(task.edits.get(dynamics))]) or "nothing added"


def format_effect(effect: Effect) -> str:
    """Return an effect's name and its parameters with their units."""
    values = ", ".join(f"{p.name} {getattr(effect, p.name):g} {p.unit}".rstrip() for p in effect.free_parameters)
    return f"{effect.name()} ({values})"


def format_edit(edit: Edit | None) -> list[str]:
    """Return the function name and arguments of an edit."""
    if isinstance(edit, ConsecutiveEdits):
        return [*format_edit(edit.first), *format_edit(edit.second)]
    if isinstance(edit, partial):
        arguments = ", ".join(f"{name}={value}" for name, value in edit.keywords.items())
        return [f"{edit.func.__name__} ({arguments})"]
    return [] if edit is None else [getattr(edit, "__name__", type(edit).__name__)]
