"""The methods: where each learns its policies, and what of the material it needs for that."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from nas_data.envs.loop.dynamics_spec import DynamicsSpec
from nas_data.errors import UnknownName
from nas_data.policies.compare import EXPERT_METHOD, SOURCE_METHOD
from nas_data.studies.experiments.pipeline.artifacts import NAMES, PHI, PHI_NAMED, PSI, Artifacts


@dataclass(frozen=True)
class Method:
    """A method.

    Attributes:
        learned_on: Where its policies learn, in a few words.
        plant: The same as a plant.
        needs: Stages of the material that it takes.
    """

    learned_on: str
    plant: Callable[[Artifacts], DynamicsSpec]
    needs: tuple[str, ...] = ()


def target(material: Artifacts) -> DynamicsSpec:
    """Return what every policy is judged on."""
    recipe = material.plan.recipe
    return DynamicsSpec(recipe.environment, recipe.dynamics, engine=recipe.engine)


def on_source(
    material: Artifacts, checkpoint: str | None = None, effects: str | None = None, randomised: bool = False
) -> DynamicsSpec:
    """Return the source with something added."""
    plan = material.plan
    return DynamicsSpec(plan.recipe.environment, plan.source, checkpoint, effects, randomised=randomised)


def named_nas(material: Artifacts) -> DynamicsSpec:
    """Return the source with names and φ; φ alone where nothing was named, names alone where they explain all."""
    if material.named is None:
        return on_source(material, material.phi)
    return on_source(material, None if material.explained else material.phi_named, material.named)


METHODS: Mapping[str, Method] = {
    EXPERT_METHOD: Method("the target itself", target),
    SOURCE_METHOD: Method("the source", on_source),
    "forward": Method("ψ, with the real reward", lambda m: on_source(m, m.psi), (PSI,)),
    "nas": Method("source + φ", lambda m: on_source(m, m.phi), (PHI,)),
    "named": Method("source + named effects", lambda m: on_source(m, effects=m.named), (NAMES,)),
    "named_nas": Method("source + named effects + φ", named_nas, (PHI, NAMES, PHI_NAMED)),
    "randomised": Method("source, randomised", lambda m: on_source(m, randomised=True)),
}


def check_methods(names: Sequence[str], known: Sequence[str]) -> None:
    """Raise UnknownName where one is no method, or none of an experiment that knows others."""
    for name in names:
        if name not in (known or METHODS):
            raise UnknownName("method", name, known or METHODS)


def needs_of(names: Sequence[str]) -> set[str]:
    """Return the stages that some methods need, without those that these build on."""
    return set[str]().union(*(METHODS[name].needs for name in names))
