"""Notes below tables of methods, on the target and on the limits of their numbers."""

from collections.abc import Sequence
from functools import partial

import numpy as np

from nas_data.effects.base import Effect
from nas_data.envs.base import SOURCE, Task
from nas_data.policies.compare import EXPERT_METHOD, SOURCE_METHOD, Comparison
from nas_data.policies.intervals import MAX_RANGE_VALUES
from nas_data.robots.base import ConsecutiveEdits, Edit
from nas_data.simulators.engines import ENGINE_NAMES
from nas_data.studies.experiments.pipeline.artifacts import METHODS, Artifacts


def describe_target(material: Artifacts) -> str:
    """Return a sentence on the target of the artifacts."""
    plan = material.plan
    description = describe_dynamics(plan.task, plan.recipe.dynamics, plan.source)
    if plan.recipe.engine == "mujoco":
        return description
    return f"{description} The target is computed by {ENGINE_NAMES[plan.recipe.engine]}, the source by MuJoCo."


def describe_dynamics(task: Task, dynamics: str, source: str = SOURCE) -> str:
    """Return a sentence on what a dynamics and its source add to the plain model.

    Raises:
        UnknownName: the task has no such dynamics; lists its dynamics.
    """
    description = f"'{dynamics}' is the plain model with {list_effects(task, dynamics)}."
    return (
        description
        if source == SOURCE
        else f"{description} Its source '{source}' is the plain model with {list_effects(task, source)}."
    )


def list_effects(task: Task, dynamics: str) -> str:
    """Return the effects of a dynamics with their joints, and its model edits."""
    joints: dict[str, list[str]] = {}
    for effect in task.effects(dynamics):
        joints.setdefault(format_effect(effect), []).append(effect.joint or "the arm")
    phrases = [f"{words} in {', '.join(places)}" for words, places in joints.items()]
    return "; ".join([*phrases, *format_edit(task.edits.get(dynamics))]) or "nothing added"


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


NAS, NAMED_NAS = "nas", "named_nas"
ONE_MATERIAL = (
    "One recording, φ, ψ and naming (each of seed 0) serve all seeds: the spread is that of PPO alone, without that of "
    "recording, models and names."
)

ONE_MODEL = "There is one φ and one ψ, of seed 0 and from one recording: the numbers have no spread over trainings."

WITHOUT_ENDS = (
    "With both expert and source among --methods the table gives the share of the distance between them that each "
    "other method closes; finished runs are not repeated."
)


def list_model_notes(material: Artifacts) -> list[str]:
    """Return the sentences below a table of φ and ψ."""
    return [describe_target(material), ONE_MODEL]


def list_notes(material: Artifacts, comparison: Comparison) -> list[str]:
    """Return the sentences below a table of methods."""
    advantage = comparison.compute_advantage()
    nothing = None if advantage is None else advantage.sentence()
    notes = [describe_target(material)]
    notes += [nothing] if nothing else []
    notes += (
        [WITHOUT_ENDS] if advantage is None and {*comparison.study.methods} - {EXPERT_METHOD, SOURCE_METHOD} else []
    )
    notes += [ONE_MATERIAL] if any(METHODS[method].needs for method in comparison.study.methods) else []
    notes += [*comparison.shared(), *describe_names_alone(material, comparison)]
    notes += [
        describe_intervals(len(comparison.study.seeds)),
        *describe_return_differences(comparison),
        *comparison.describe_diverged(),
    ]
    return [sentence for sentence in notes if sentence]


def describe_names_alone(material: Artifacts, comparison: Comparison) -> Sequence[str]:
    """Return a note if named + φ equals the named effects alone."""
    if NAMED_NAS not in comparison.study.methods or not material.explained:
        return ()
    return (
        "The error with the named effects is at the noise floor, so φ has nothing to learn there: "
        f"{NAMED_NAS} is the source with the names.",
    )


def describe_intervals(seeds: int) -> str:
    """Return a note on intervals over few seeds; none if there are enough seeds."""
    if not 1 < seeds <= MAX_RANGE_VALUES:
        return ""
    return (
        f"In brackets beside the median: the range of the {seeds} seeds, which contains the median of all seeds in "
        f"{1 - 2 ** (1 - seeds):.0%} of cases. A bootstrap of so few seeds gives no more, and the interval of the "
        "distance closed covers less than 95 %."
    )


def compute_return_differences(comparison: Comparison) -> np.ndarray | None:
    """Return the difference of returns of named + φ and φ by seed, shape (seeds,); None if one is missing."""
    if not {NAS, NAMED_NAS} <= set(comparison.study.methods):
        return None
    return comparison.values(NAMED_NAS) - comparison.values(NAS)


def describe_return_differences(comparison: Comparison) -> Sequence[str]:
    """Return a note on named + φ against φ alone, seed by seed."""
    apart = compute_return_differences(comparison)
    if apart is None:
        return ()
    return (
        f"{NAMED_NAS} − {NAS}, seed by seed: median {np.median(apart):+.2f}, {apart.min():+.2f} … {apart.max():+.2f} "
        f"over {len(apart)} seeds.",
    )


def describe_paired(comparison: Comparison) -> dict[str, object] | None:
    """Return the paired comparison for JSON; None if one is missing."""
    apart = compute_return_differences(comparison)
    if apart is None:
        return None
    return {
        "differences": apart.tolist(),
        "median": float(np.median(apart)),
        "min": float(apart.min()),
        "max": float(apart.max()),
    }
