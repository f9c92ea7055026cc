"""What all methods of an environment are made from: recordings, φ, ψ and names; built once, whatever the seeds."""

from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path

from nas_data import __version__
from nas_data.dataset import versions
from nas_data.dataset.provenance import read_provenance
from nas_data.envs.base import SOURCE, Task, find_task, find_task_file
from nas_data.gap.named import Named
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
    """What the material depends on.

    Attributes:
        recipe: How the target is recorded.
        heldout: Further episodes that models are judged on; their seed is the next one.
        delta: Training of φ.
        forward: Training of ψ.
        named: Recorded episodes that `nas gap` is given; all where None.
    """

    recipe: Recipe
    heldout: int
    delta: TrainingOptions
    forward: TrainingOptions
    named: int | None = None

    @property
    def task(self) -> Task:
        """What the environment is about."""
        return find_task(self.recipe.environment)

    @property
    def source(self) -> str:
        """The dynamics that the gap begins at: `source`, or where a dynamics has a source of its own, that."""
        own = f"{self.recipe.dynamics}-{SOURCE}"
        return own if own in self.task.dynamics else SOURCE

    def source_with(self, names: str | Path) -> Predictor:
        """Return the source with what a gap report named."""
        named, body = Named.read(names), Predictor.of(self.recipe.environment, self.source)
        return Predictor(named.robot(body.robot, self.task.joints), (*body.effects, *named.effects))

    def describe(self) -> dict[str, object]:
        """Return what the material depends on, for JSON."""
        dynamics = (self.source, self.recipe.dynamics)
        models = {name: self.task.body(name)[0].sha256 for name in dynamics}
        effects = {name: [effect.to_json() for effect in self.task.effects(name)] for name in dynamics}
        recipe = {**asdict(self.recipe), "environment": find_task_file(self.recipe.environment)}
        return {"nas_data": __version__, **asdict(self), "recipe": recipe, "models": models, "effects": effects}


@dataclass(frozen=True)
class Artifacts:
    """Material as it lies in a folder.

    Attributes:
        plan: What it was made by.
        folder: Where.
    """

    plan: MaterialPlan
    folder: Path

    @property
    def train(self) -> Path:
        """Folder of the pairs that models learn from."""
        return versions.resolve(self.folder / DATASETS / TRAIN)

    @property
    def heldout(self) -> Path:
        """Folder of the pairs that they are judged on."""
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
        """Folder of the gap report; None where it names nothing and retunes nothing: that is the source."""
        named = Named.read(self.folder / NAMES)
        return str(self.folder / NAMES) if named.effects or named.retuned else None

    @property
    def explained(self) -> bool:
        """Whether what the names leave is at the recordings' noise floor, so that φ has nothing to learn there."""
        return read_stage(NAMES, self.folder).data.get("verdict") in EXPLAINED

    @property
    def phi_named(self) -> str:
        """Checkpoint of the φ that corrects the source with the names."""
        return str(self.folder / PHI_NAMED)

    @property
    def content_hash(self) -> str:
        """Content hash of the pairs that models learn from."""
        provenance = read_provenance(self.train)
        return provenance.content_hash if provenance else ""

    def simulator(self) -> Simulator:
        """Return the source."""
        return self.plan.task.simulator(self.plan.source)

    def paper_protocol(self) -> list[int]:
        """Return the held-out episodes that follow the paper's protocol."""
        kinds = replace(self.plan.recipe, episodes=self.plan.heldout).kinds()
        return [episode for episode, kind in enumerate(kinds) if kind == kinds[0]]
