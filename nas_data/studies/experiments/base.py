"""Interface of experiments: a figure or table of the paper, with results as JSON, tables and pictures."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from nas_data import registry
from nas_data.environment_ids import make_environment_name
from nas_data.envs.base import find_task_file
from nas_data.runs.parallel import ONE_WORKER, Workers
from nas_data.runs.planned_jobs import PlannedJob
from nas_data.simulators.engines import ENGINE_NAMES
from nas_data.studies.experiments.pipeline.artifacts import Artifacts, MaterialPlan
from nas_data.studies.experiments.pipeline.sizes import Sizes
from nas_data.text_table import format_markdown_table, format_table

FOLDER = "studies.experiments"


@dataclass(frozen=True)
class Request:
    """Settings of an experiment."""

    environments: tuple[str, ...]  # names of the environments
    dynamics: str  # dynamics of the target, one of each environment's
    sizes: Sizes  # sizes of datasets and trainings
    folder: Path  # folder of results and artifacts; experiments with the same folder share artifacts
    report: Callable[[str], None]  # called with lines of progress
    methods: tuple[str, ...] = ()  # methods to compare, if the experiment compares methods
    workers: Workers = ONE_WORKER  # where trainings run
    purpose: str = "material"  # subfolder of the artifacts, one for each set of sizes
    full_sizes: Sizes | None = (
        None  # sizes of the whole experiment, to distinguish files of parts of it; `sizes` if None
    )
    engine: str = "mujoco"  # physics engine of the target; the source always uses MuJoCo

    @property
    def target(self) -> str:
        """Name of the target, for file names."""
        return self.dynamics if self.engine == "mujoco" else f"{self.dynamics}-{self.engine}"

    @property
    def target_text(self) -> str:
        """Name of the target, for titles."""
        return f"'{self.dynamics}'" if self.engine == "mujoco" else f"'{self.dynamics}' in {ENGINE_NAMES[self.engine]}"

    def home(self, environment: str) -> Path:
        """Return the folder of an environment's artifacts and policies; quick runs have their own."""
        name = f"{make_environment_name(find_task_file(environment))}-{self.target}"
        return (self.folder / self.sizes.name if self.sizes.quick else self.folder) / name

    def material(self, environment: str, needs: Sequence[str]) -> Artifacts:
        """Build the required artifacts of an environment; see `make_material`."""
        from nas_data.studies.experiments.pipeline.stages import make_material

        self.report(f"{environment}, dynamics {self.target_text} → {self.home(environment)}")
        plan = self.plan_material(environment)
        return make_material(plan, self.home(environment) / self.purpose, needs, self.report, self.workers)

    def plan_material(self, environment: str) -> MaterialPlan:
        """Return the settings of an environment's artifacts."""
        sizes, recipe = self.sizes, self.sizes.recipe(environment, self.dynamics, self.engine)
        return MaterialPlan(recipe, sizes.heldout, sizes.phi(environment), sizes.forward, sizes.named)


@dataclass(frozen=True)
class ResultTable:
    """A table."""

    title: str  # title, with units
    headers: Sequence[str]  # column headings
    rows: Sequence[Sequence[str]]  # cells, row by row
    notes: Sequence[str] = ()  # sentences below the table

    def text(self) -> str:
        """Return the table as aligned text."""
        return "\n".join([self.title, format_table(self.headers, self.rows), *self.notes])

    def markdown(self) -> str:
        """Return the table as Markdown."""
        return "\n\n".join([self.title, format_markdown_table(self.headers, self.rows), *self.notes])


@dataclass(frozen=True)
class ExperimentResult:
    """Results of an experiment."""

    tables: Sequence[ResultTable]
    notes: Sequence[str]  # sentences below them
    data: Mapping[str, object]  # values for JSON
    # PNG files by name suffix; the first one has the experiment's name
    pictures: Mapping[str, bytes] = field(default_factory=dict)


@dataclass(frozen=True)
class Experiment:
    """An experiment; the file `experiments/a.py` holds the experiment `a` as `EXPERIMENT`."""

    title: str  # title of a few words
    environments: tuple[str, ...]  # the paper's environments
    run: Callable[[Request], ExperimentResult]  # function that runs it
    several: bool = True  # whether it supports several environments at a time
    methods: tuple[str, ...] = ()  # available methods; if empty, those of figure 5
    # function that lists its jobs before it runs
    plan: Callable[[Request], list[PlannedJob]] = field(kw_only=True)


def find_experiment(name: str) -> Experiment:
    """Return an experiment by its name.

    Raises:
        UnknownName: there is no such experiment; lists the experiments.
    """
    return registry.find_value(FOLDER, name, "experiment", Experiment)
