"""Bases of the experiments' commands: options, and the request made from them."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal

from nas_data.commands._long import LongCommand
from nas_data.commands.base import CommandResult
from nas_data.environment_ids import TARGET_DYNAMICS
from nas_data.runs.progress import say

if TYPE_CHECKING:
    from nas_data.studies.experiments.pipeline.sizes import Sizes


@dataclass(frozen=True, kw_only=True)
class ExperimentCommand(LongCommand):
    """Options of every experiment."""

    experiment: ClassVar[str]

    env: tuple[str, ...] = ()
    """Environments; by default those of the paper, with --quick only the first."""
    dynamics: str = TARGET_DYNAMICS
    """Dynamics of the target, such as backlash or paper; an unknown name lists all."""
    engine: Literal["mujoco", "bullet"] = "mujoco"
    """Physics engine of the target; the source runs in MuJoCo, so that `bullet` adds the difference of the engines."""
    quick: bool = False
    """A trial run in a few minutes with too little data for a result; stored apart from the full experiment."""
    out: Path = Path("runs/experiments")
    """Folder of results, and of the recordings, models and policies that the experiments share."""

    def run(self) -> CommandResult:
        """Run or resume the experiment."""
        from nas_data.studies.experiments.base import Request, find_experiment
        from nas_data.studies.experiments.pipeline.run import list_experiment_jobs, run_experiment
        from nas_data.studies.experiments.pipeline.sizes import FULL, QUICK

        known = find_experiment(self.experiment).environments
        request = Request(
            environments=self.env or (known[:1] if self.quick else known),
            dynamics=self.dynamics,
            sizes=self.sizes(),
            folder=self.out,
            report=say,
            methods=self.chosen_methods(),
            workers=self.find_workers(self.out),
            full_sizes=QUICK if self.quick else FULL,
            engine=self.engine,
        )
        if self.dry_run:
            return self.list_jobs(list_experiment_jobs(self.experiment, request))
        made = run_experiment(self.experiment, request)
        return CommandResult(made.text, made.data)

    def sizes(self) -> "Sizes":
        """Return the sizes of the experiment."""
        from nas_data.studies.experiments.pipeline.sizes import FULL, QUICK

        return QUICK if self.quick else FULL

    def chosen_methods(self) -> tuple[str, ...]:
        """Return the methods to compare; empty for the experiment's own."""
        return ()


@dataclass(frozen=True, kw_only=True)
class PolicyExperimentCommand(ExperimentCommand):
    """Options of experiments that train policies."""

    seeds: tuple[int, ...] = ()
    """Seeds of every method; five by default, with --quick two."""
    frames: int | None = None
    """Control steps of each policy; by default two million as in the paper, with --quick fewer."""
    ppo: Literal["ours", "authors"] = "ours"
    """Hyperparameters of PPO: ours, 16 arms × 512 steps per rollout, as long as in the paper's robot experiments; or
    the authors' in simulation, one arm × 2048 steps, 32 minibatches of 64, 10 epochs."""

    def sizes(self) -> "Sizes":
        """Return the sizes of the experiment with the given options."""
        from dataclasses import replace

        sizes = super().sizes()
        frames = sizes.frames if self.frames is None else self.frames
        return replace(sizes.with_ppo(self.ppo), frames=frames, seeds=self.seeds or sizes.seeds)


@dataclass(frozen=True, kw_only=True)
class MethodsExperimentCommand(PolicyExperimentCommand):
    """Options of experiments that compare methods."""

    methods: tuple[str, ...] = ()
    """Methods: expert, source, forward, nas, named, named_nas, randomised; all by default."""

    def chosen_methods(self) -> tuple[str, ...]:
        """Return the methods to compare."""
        return self.methods
