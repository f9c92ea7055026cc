"""Which code decides each stage of an environment's material: other code's recordings, models and names are refused."""

from nas_data import registry
from nas_data.code_hash import code_hash
from nas_data.envs.loop.plant import Plant
from nas_data.experiments.pipeline.material import MaterialPlan


def source_modules(plan: MaterialPlan) -> tuple[str, ...]:
    """Return the modules that decide how the source moves."""
    return Plant(plan.recipe.environment, plan.source).modules()


def recording_code(plan: MaterialPlan) -> str:
    """Return the hash of what records the target and pairs it with the source."""
    recipe = plan.recipe
    target = Plant(recipe.environment, recipe.dynamics, engine=recipe.engine).modules()
    return code_hash(*target, *source_modules(plan), "nas_data.experiments.pipeline.pairs")


def learning_code(plan: MaterialPlan) -> str:
    """Return the hash of what trains φ and ψ."""
    return code_hash(*source_modules(plan), "nas_data.models.run")


def naming_code(plan: MaterialPlan) -> str:
    """Return the hash of what names effects: the search, and every effect that it may name."""
    catalogue = (f"nas_data.effects.{name}" for name in registry.names("effects"))
    return code_hash(*source_modules(plan), *catalogue, "nas_data.gap.workflow")


def learning_on_names_code(plan: MaterialPlan) -> str:
    """Return the hash of what pairs the source that has the names, and trains φ on it."""
    catalogue = (f"nas_data.effects.{name}" for name in registry.names("effects"))
    return code_hash(*source_modules(plan), *catalogue, "nas_data.experiments.pipeline.pairs", "nas_data.models.run")
