"""Settings of the demo."""

from dataclasses import asdict, dataclass

from nas_data import __version__
from nas_data.envs.base import SOURCE, Task, find_task
from nas_data.envs.loop.dynamics_spec import DynamicsSpec
from nas_data.models.presets import TrainingOptions, preset
from nas_data.robots.base import find_robot
from nas_data.runs.stages import Work


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
        """What the policies are to do."""
        return find_task(self.environment)

    @property
    def target(self) -> DynamicsSpec:
        """The simulated plant in place of the robot."""
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
    # The expert's plant is the hardest to learn on: with 300,000 steps others are ahead of it. One long training each
    # says more than two short ones.
    frames=400_000,
    seeds=(0,),
    judged=100,
)

# So small that nothing is learned: it shows, within a minute, that every stage works here.
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
