"""Sizes and stages of the demo."""

from collections.abc import Callable
from dataclasses import asdict, dataclass
from importlib import import_module
from pathlib import Path

from nas_data import __version__
from nas_data.envs.base import SOURCE, Task, find_task
from nas_data.envs.loop.dynamics_spec import DynamicsSpec
from nas_data.models.presets import TrainingOptions, preset
from nas_data.robots.base import find_robot
from nas_data.runs.progress import Report
from nas_data.runs.stages import Done, Stage, StageResult, Work, run_stages


@dataclass(frozen=True)
class DemoPlan:
    """Sizes of the demo."""

    episodes: int  # number of training episodes
    heldout: int  # number of held-out episodes
    named: int  # number of recorded episodes for `nas gap`; 0 skips its search
    seconds: float  # length of each episode [s]
    # durations of random commands [s]; the episodes take them in turn. One second is the paper's protocol; shorter ones
    # resemble the exploration of a policy.
    holds: tuple[float, ...]
    delta: TrainingOptions  # training of φ
    forward: TrainingOptions  # training of ψ
    frames: int  # control steps of each policy's training
    seeds: tuple[int, ...]  # seeds of the policies of each method
    judged: int  # evaluation episodes of each policy
    rollout: int = 8192  # control steps between two updates of a policy
    minibatches: int = 32  # parts of a rollout, one gradient step each
    epochs: int = 10  # passes over a rollout
    seed: int = 0  # seed of the recordings; the held-out episodes take the next one
    environment: str = "ErgoReacher"  # name of the environment
    dynamics: str = "backlash"  # name of the environment's dynamics that is the target

    @property
    def task(self) -> Task:
        """Task of the policies."""
        return find_task(self.environment)

    @property
    def target(self) -> DynamicsSpec:
        """Simulated target in place of the robot."""
        return DynamicsSpec(self.environment, self.dynamics)

    @property
    def source(self) -> DynamicsSpec:
        """The plain simulator."""
        return DynamicsSpec(self.environment, SOURCE)

    def describe(self) -> dict[str, object]:
        """Return the settings that determine the results, for JSON."""
        robot = find_robot(self.task.robot)
        effects = {name: list(self.task.dynamics[name]) for name in (SOURCE, self.dynamics)}
        return {"nas_data": __version__, **asdict(self), "robot": robot.name, "model": robot.sha256, "effects": effects}


Demo = Work[DemoPlan]
"""A demo in a folder."""

FULL = DemoPlan(
    episodes=200,
    heldout=40,
    named=12,
    seconds=3.0,
    holds=(1.0, 0.2, 0.05, 0.01),
    delta=preset("fast", updates=100, horizon=100),
    forward=preset("fast", updates=160, horizon=100),
    # The expert learns most slowly: with 300,000 steps others are ahead of it. One long training is more informative
    # than two short ones.
    frames=400_000,
    seeds=(0,),
    judged=100,
)

# Too small to learn anything: shows within a minute that every stage works.
QUICK = DemoPlan(
    episodes=20,
    heldout=4,
    named=0,
    seconds=1.0,
    holds=(0.5, 0.01),
    delta=preset("fast", hidden=8, updates=4, horizon=20),
    forward=preset("fast", hidden=8, updates=4, horizon=20),
    frames=2_000,
    seeds=(0,),
    judged=4,
    rollout=1024,
    minibatches=4,
    epochs=2,
)


def import_lazily(module: str, function: str) -> Callable[[Demo], StageResult]:
    """Return the function of a stage whose module, with heavy libraries, is imported when the stage runs."""

    def run(demo: Demo) -> StageResult:
        result: StageResult = getattr(import_module(f"nas_data.studies.demo.{module}"), function)(demo)
        return result

    return run


STAGES = (
    Stage(
        "record",
        "Record and pair",
        "An arm of six servos (Poppy Ergo Jr) is moved to random targets and measured. It stands in for a real robot: "
        "two of its joints have play and its servos have a speed limit, which the plain simulator lacks. That "
        "simulator is then set to every measured state and given the same command.",
        import_lazily("recording", "record_pairs"),
        ("datasets",),
    ),
    Stage(
        "names",
        "Name what is missing",
        "`nas gap` is given episodes of the recording and the plain simulator, but not the differences. It finds "
        "where the two disagree, names the effects that the simulator lacks, and adds them to its model.",
        import_lazily("recording", "name_effects"),
        ("gap",),
    ),
    Stage(
        "models",
        "Learn the gap",
        "Two networks learn from the pairs, side by side: φ corrects each step of the simulator, ψ predicts without a "
        "simulator. Both are trained on their own rollouts. 'validation' is the error of such rollouts [rad]; "
        "* marks the best so far, which is kept. Then both are compared with the simulator, and "
        "with one that has the names, if any.",
        import_lazily("learning", "learn_models"),
        ("models",),
    ),
    Stage(
        "policies",
        "Learn policies",
        "The task is to reach a point with the arm's tip. Policies learn it by PPO on the target (expert), in the "
        "plain simulator (source), in the simulator corrected by φ (augmented), in ψ (forward) and, if there are "
        "names, in the simulator with them (named). Then each is evaluated on the target.",
        import_lazily("learning", "learn_policies"),
        ("policies",),
    ),
    Stage("page", "Show", "Charts and tables go on one page.", import_lazily("page", "write_page"), ("report.html",)),
)


def run_demo(plan: DemoPlan, folder: Path, report: Report) -> dict[str, Done]:
    """Run the unfinished stages of a demo in a folder.

    Raises:
        OutputExists: the folder holds something else, or a demo of other sizes.
    """
    return run_stages(STAGES, Demo(plan, folder, report))
