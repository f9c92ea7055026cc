"""Artifacts shared by all methods of an environment: recordings, φ, ψ and named effects; built once for all seeds."""

from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path

from nas_data import __version__
from nas_data.dataset import versions
from nas_data.dataset.provenance import read_provenance
from nas_data.envs.base import SOURCE, Task, find_task, find_task_file
from nas_data.gap.model_correction import ModelCorrection
from nas_data.gap.verdict import EXPLAINED
from nas_data.models.presets import TrainingOptions
from nas_data.recorders.recipe import Recipe
from nas_data.runs.stages import read_stage
from nas_data.simulators.base import Simulator
from nas_data.studies.experiments.pipeline.pairs import Predictor

DATASETS, PHI, PSI, NAMES, PHI_NAMED = "datasets", "phi", "psi", "names", "phi_named"
TRAIN, HELDOUT, NAMED = "train", "heldout", "train_named"


@dataclass(frozen=True)
class MaterialPlan:
    """Settings of the artifacts.

    Attributes:
        recipe: Recording of the target.
        heldout: Number of held-out episodes, recorded with the next seed.
        delta: Training of φ.
        forward: Training of ψ.
        named: Number of recorded episodes for `nas gap`; all if None.
    """

    recipe: Recipe
    heldout: int
    delta: TrainingOptions
    forward: TrainingOptions
    named: int | None = None

    @property
    def task(self) -> Task:
        """The task of the environment."""
        return find_task(self.recipe.environment)

    @property
    def source(self) -> str:
        """Dynamics of the source: `source`, or the dynamics' own source if it has one."""
        own = f"{self.recipe.dynamics}-{SOURCE}"
        return own if own in self.task.dynamics else SOURCE

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
    """Artifacts in a folder.

    Attributes:
        plan: Their settings.
        folder: Their folder.
    """

    plan: MaterialPlan
    folder: Path

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
        return read_stage(NAMES, self.folder).data.get("verdict") in EXPLAINED

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
