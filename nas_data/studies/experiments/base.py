"""What an experiment is: a figure or table of the paper, made from a request, ending in JSON, table and pictures."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from nas_data import registry
from nas_data.environment_ids import environment_name
from nas_data.envs.base import find_task_file
from nas_data.simulators.engines import ENGINE_NAMES
from nas_data.studies.experiments.pipeline.artifacts import Artifacts, MaterialPlan
from nas_data.studies.experiments.pipeline.sizes import Sizes

FOLDER = "studies.experiments"


@dataclass(frozen=True)
class Request:
    """What is asked of an experiment.

    Attributes:
        environments: Their names.
        dynamics: What the target is: one of each environment's dynamics.
        sizes: How large everything is.
        folder: Where results and what they are made from go; experiments that share it share that.
        report: Told of progress, in lines for people.
        methods: Methods to compare, where the experiment compares some.
        workers: Processes side by side.
        purpose: Folder of the material below the environment's; another where it is of other sizes.
        whole: Sizes of the whole experiment, so that files of a part of it are told apart; `sizes` where None.
        engine: What computes the target; MuJoCo always computes the source.
    """

    environments: tuple[str, ...]
    dynamics: str
    sizes: Sizes
    folder: Path
    report: Callable[[str], None]
    methods: tuple[str, ...] = ()
    workers: int = 1
    purpose: str = "material"
    whole: Sizes | None = None
    engine: str = "mujoco"

    @property
    def target(self) -> str:
        """What the target is, for names of files."""
        return self.dynamics if self.engine == "mujoco" else f"{self.dynamics}-{self.engine}"

    @property
    def target_text(self) -> str:
        """What the target is, for titles."""
        return f"'{self.dynamics}'" if self.engine == "mujoco" else f"'{self.dynamics}' in {ENGINE_NAMES[self.engine]}"

    def home(self, environment: str) -> Path:
        """Return the folder of an environment's material and policies; quick ones are apart."""
        name = f"{environment_name(find_task_file(environment))}-{self.target}"
        return (self.folder / self.sizes.name if self.sizes.quick else self.folder) / name

    def material(self, environment: str, needs: Sequence[str]) -> Artifacts:
        """Make what is needed of an environment's material; see `make_material`."""
        from nas_data.studies.experiments.pipeline.stages import make_material

        sizes = self.sizes
        recipe = sizes.recipe(environment, self.dynamics, self.engine)
        plan = MaterialPlan(recipe, sizes.heldout, sizes.phi(environment), sizes.forward, sizes.named)
        self.report(f"{environment}, dynamics {self.target_text} → {self.home(environment)}")
        return make_material(plan, self.home(environment) / self.purpose, needs, self.report, self.workers)


@dataclass(frozen=True)
class ResultTable:
    """A table.

    Attributes:
        title: What it shows, with units.
        headers: Of its columns.
        rows: Its cells.
        notes: Sentences right below it.
    """

    title: str
    headers: Sequence[str]
    rows: Sequence[Sequence[str]]
    notes: Sequence[str] = ()

    def text(self) -> str:
        """Return it for a terminal."""
        from nas_data.policies.tables import align_columns

        return "\n".join([self.title, align_columns(self.headers, self.rows), *self.notes])

    def markdown(self) -> str:
        """Return it as Markdown."""
        lines = ["| " + " | ".join(row) + " |" for row in (self.headers, ["---"] * len(self.headers), *self.rows)]
        return "\n\n".join([self.title, "\n".join(lines), *self.notes])


@dataclass(frozen=True)
class ExperimentResult:
    """What an experiment found.

    Attributes:
        tables: What people read.
        notes: Sentences below them.
        data: For machines.
        pictures: PNG files by the end of their names; the first under the experiment's own.
    """

    tables: Sequence[ResultTable]
    notes: Sequence[str]
    data: Mapping[str, object]
    pictures: Mapping[str, bytes] = field(default_factory=dict)


@dataclass(frozen=True)
class Experiment:
    """An experiment; the file `experiments/a.py` holds the experiment `a` as `EXPERIMENT`.

    Attributes:
        title: What it shows, in a few words.
        environments: Those of the paper.
        run: Makes it.
        several: Whether it can be about several environments at a time.
        methods: Those that it can be asked for; where empty, those that figure 5 compares.
    """

    title: str
    environments: tuple[str, ...]
    run: Callable[[Request], ExperimentResult]
    several: bool = True
    methods: tuple[str, ...] = ()


def experiments() -> tuple[str, ...]:
    """Return the names of all experiments."""
    return registry.names(FOLDER)


def find_experiment(name: str) -> Experiment:
    """Return an experiment by its name.

    Raises:
        UnknownName: there is no such experiment; lists those there are.
    """
    return registry.value(FOLDER, name, "experiment", Experiment)
