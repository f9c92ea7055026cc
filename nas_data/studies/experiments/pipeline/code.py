"""Hashes of the code behind each stage of an environment's artifacts; results of other code are refused."""

from nas_data.envs.loop.dynamics_spec import DynamicsSpec
from nas_data.runs.code_hash import code_hash, effect_modules, gap_modules
from nas_data.studies.experiments.pipeline.artifacts import MaterialPlan


def source_modules(plan: MaterialPlan) -> tuple[str, ...]:
    """Return the modules that determine the source's motion."""
    return DynamicsSpec(plan.recipe.environment, plan.source).modules()


def recording_code(plan: MaterialPlan) -> str:
    """Return the hash of the code that records the target and pairs it with the source."""
    recipe = plan.recipe
    target = DynamicsSpec(recipe.environment, recipe.dynamics, engine=recipe.engine).modules()
    return code_hash(*target, *source_modules(plan), "nas_data.studies.experiments.pipeline.pairs")


def learning_code(plan: MaterialPlan) -> str:
    """Return the hash of the code that trains φ and ψ."""
    return code_hash(*source_modules(plan), "nas_data.models.run")


def naming_code(plan: MaterialPlan) -> str:
    """Return the hash of the code that names effects: the search and all effects."""
    return code_hash(*source_modules(plan), *gap_modules())


def learning_on_names_code(plan: MaterialPlan) -> str:
    """Return the hash of the code that pairs the source with named effects, and trains φ on it."""
    pairing = (*effect_modules(), "nas_data.gap.named", "nas_data.studies.experiments.pipeline.pairs")
    return code_hash(*source_modules(plan), *pairing, "nas_data.models.run")
