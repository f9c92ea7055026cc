"""The methods: dynamics on which each trains its policies, and the artifacts it needs."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from nas_data.envs.loop.dynamics_spec import DynamicsSpec
from nas_data.errors import UnknownName
from nas_data.policies.compare import EXPERT_METHOD, SOURCE_METHOD
from nas_data.studies.experiments.pipeline.artifacts import NAMES, PHI, PHI_NAMED, PSI, Artifacts


@dataclass(frozen=True)
class Method:
    """A method."""

    learned_on: str  # description of its training dynamics, in a few words
    plant: Callable[[Artifacts], DynamicsSpec]  # its training dynamics
    needs: tuple[str, ...] = ()  # stages of the artifacts that it needs


def make_target(material: Artifacts) -> DynamicsSpec:
    """Return the target, on which every policy is evaluated."""
    recipe = material.plan.recipe
    return DynamicsSpec(recipe.environment, recipe.dynamics, engine=recipe.engine)


def add_to_source(
    material: Artifacts, checkpoint: str | None = None, effects: str | None = None, randomised: bool = False
) -> DynamicsSpec:
    """Return the source with something added."""
    plan = material.plan
    return DynamicsSpec(plan.recipe.environment, plan.source, checkpoint, effects, randomised=randomised)


def make_named_nas(material: Artifacts) -> DynamicsSpec:
    """Return the source with named effects and φ; one of them alone if the other is empty."""
    if material.named is None:
        return add_to_source(material, material.phi)
    return add_to_source(material, None if material.explained else material.phi_named, material.named)


METHODS: Mapping[str, Method] = {
    EXPERT_METHOD: Method("the target itself", make_target),
    SOURCE_METHOD: Method("the source", add_to_source),
    "forward": Method("ψ, with the real reward", lambda m: add_to_source(m, m.psi), (PSI,)),
    "nas": Method("source + φ", lambda m: add_to_source(m, m.phi), (PHI,)),
    "named": Method("source + named effects", lambda m: add_to_source(m, effects=m.named), (NAMES,)),
    "named_nas": Method("source + named effects + φ", make_named_nas, (PHI, NAMES, PHI_NAMED)),
    "randomised": Method("source, randomised", lambda m: add_to_source(m, randomised=True)),
}


def check_methods(names: Sequence[str], known: Sequence[str]) -> None:
    """Raise UnknownName if a method does not exist or does not belong to the experiment."""
    for name in names:
        if name not in (known or METHODS):
            raise UnknownName("method", name, known or METHODS)


def list_needed_stages(names: Sequence[str]) -> set[str]:
    """Return the stages that methods need, without their dependencies."""
    return set[str]().union(*(METHODS[name].needs for name in names))
