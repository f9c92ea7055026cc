"""Artifacts shared by all methods of an environment, built once for all seeds, and the methods that learn on them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path

from nas_data import __version__
from nas_data.dataset import versions
from nas_data.dataset.provenance import read_provenance
from nas_data.envs.base import Task, find_task, find_task_file
from nas_data.envs.loop.dynamics_spec import DynamicsSpec
from nas_data.errors import UnknownName
from nas_data.gap.model_correction import ModelCorrection
from nas_data.gap.verdict import EXPLAINED_VERDICTS
from nas_data.models.presets import TrainingOptions
from nas_data.policies.compare import EXPERT_METHOD, SOURCE_METHOD
from nas_data.recorders.recipe import Recipe
from nas_data.runs.stages import read_stage
from nas_data.simulators.base import Simulator
from nas_data.studies.experiments.pipeline.pairs import Predictor

DATASETS, PHI, PSI, NAMES, PHI_NAMED = "datasets", "phi", "psi", "names", "phi_named"
TRAIN, HELDOUT, NAMED = "train", "heldout", "train_named"


@dataclass(frozen=True)
class MaterialPlan:
    """Settings of the artifacts."""

    recipe: Recipe  # recording of the target
    heldout: int  # number of held-out episodes, recorded with the next seed
    delta: TrainingOptions  # training of φ
    forward: TrainingOptions  # training of ψ
    named: int | None = None  # number of recorded episodes for `nas gap`; all if None

    @property
    def task(self) -> Task:
        """The task of the environment."""
        return find_task(self.recipe.environment)

    @property
    def source(self) -> str:
        """Dynamics of the source: `source`, or the dynamics' own source if it has one."""
        return self.task.find_source(self.recipe.dynamics)

    def source_with(self, names: str | Path) -> Predictor:
        """Return the source with the effects of a gap report."""
        named, body = ModelCorrection.read(names), Predictor.of(self.recipe.environment, self.source)
        return Predictor(named.robot(body.robot, self.task.joints), (*body.effects, *named.effects))

    def describe(self) -> dict[str, object]:
        """Return the settings for JSON."""
        dynamics = (self.source, self.recipe.dynamics)
        models = {name: self.task.body(name)[0].sha256 for name in dynamics}
        effects = {name: [effect.to_json() for effect in self.task.effects(name)] for name in dynamics}
        recipe = {**asdict(self.recipe), "environment": find_task_file(self.recipe.environment)}
        return {"nas_data": __version__, **asdict(self), "recipe": recipe, "models": models, "effects": effects}


@dataclass(frozen=True)
class Artifacts:
    """Artifacts in a folder."""

    plan: MaterialPlan  # their settings
    folder: Path  # their folder

    @property
    def train(self) -> Path:
        """Folder of the training pairs."""
        return versions.resolve(self.folder / DATASETS / TRAIN)

    @property
    def heldout(self) -> Path:
        """Folder of the held-out pairs."""
        return versions.resolve(self.folder / DATASETS / HELDOUT)

    @property
    def phi(self) -> str:
        """Checkpoint of φ."""
        return str(self.folder / PHI)

    @property
    def psi(self) -> str:
        """Checkpoint of ψ."""
        return str(self.folder / PSI)

    @cached_property
    def named(self) -> str | None:
        """Folder of the gap report; None if it has neither effects nor changed base parameters."""
        named = ModelCorrection.read(self.folder / NAMES)
        return str(self.folder / NAMES) if named.effects or named.retuned else None

    @property
    def explained(self) -> bool:
        """Whether the residual after naming is at the noise floor, so that φ has nothing to learn."""
        return read_stage(NAMES, self.folder).data.get("verdict") in EXPLAINED_VERDICTS

    @property
    def phi_named(self) -> str:
        """Checkpoint of the φ for the source with named effects."""
        return str(self.folder / PHI_NAMED)

    @property
    def content_hash(self) -> str:
        """Content hash of the training pairs."""
        provenance = read_provenance(self.train)
        return provenance.content_hash if provenance else ""

    def simulator(self) -> Simulator:
        """Return the source."""
        return self.plan.task.simulator(self.plan.source)

    def paper_protocol(self) -> list[int]:
        """Return the held-out episodes that follow the paper's protocol."""
        kinds = replace(self.plan.recipe, episodes=self.plan.heldout).kinds()
        return [episode for episode, kind in enumerate(kinds) if kind == kinds[0]]


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
    """Return the source with additions."""
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
