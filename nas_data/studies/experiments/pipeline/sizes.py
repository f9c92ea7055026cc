"""Sizes of the experiments: as in the paper, or small for a quick look."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

from nas_data.count_of import count_of
from nas_data.envs.base import find_task, find_task_file
from nas_data.errors import UnknownName
from nas_data.models.presets import TrainingOptions, preset
from nas_data.recorders.recipe import Recipe

FOR_FEW = ("few", "symmetric")  # presets for training from few trajectories


@dataclass(frozen=True)
class RecordingSize:
    """Size of an environment's recording."""

    # number of episodes, as in the paper (sections 4.3 and 4.4) except for ErgoShield. Pusher has the number behind the
    # authors' published returns; the paper's text says 250.
    trajectories: int
    steps: int  # control steps of each episode
    hold: int  # duration of an action [control steps] in the paper's protocol, which every fourth episode follows
    longest: int  # longest action [control steps] in the other episodes; see `Recipe.varied`


# The paper draws a new action every step in simulation, and a new target every second on the arm
RECORDINGS: Mapping[str, RecordingSize] = {
    "pusher": RecordingSize(1000, 100, 1, 50),
    "striker": RecordingSize(5000, 100, 1, 50),
    "ergo_reacher": RecordingSize(1000, 100, 1, 100),
    "ergo_shield": RecordingSize(2000, 300, 100, 100),  # the paper has 500; φ overfits them here
}
# Ours is that of the paper's robot experiments, 16 arms side by side in place of 4 processes; in simulation the authors
# had one process of 2048 steps, 32 minibatches of 64 and 10 epochs (paper, appendix C; facts in reference/paper.md, 5)
OURS = "ours"
PPO: Mapping[str, Mapping[str, int]] = {
    OURS: {},
    "authors": {"arms": 1, "rollout": 2048, "minibatches": 32, "epochs": 10},
}


@dataclass(frozen=True)
class Sizes:
    """Sizes of every experiment."""

    name: str  # `full` or `quick`
    heldout: int  # number of held-out episodes
    delta: TrainingOptions  # training of φ, except for environments in `PHI`
    forward: TrainingOptions  # training of ψ
    presets: Mapping[str, TrainingOptions]  # trainings of φ by other presets in figure 6, by name
    frames: int  # control steps of each policy's training
    seeds: tuple[int, ...]  # seeds of each method
    judged: int  # evaluation episodes of each policy
    counts: tuple[int, ...]  # numbers of training trajectories in figure 6
    trajectories: int | None = None  # number of recorded episodes; the paper's if None
    named: int | None = None  # number of episodes for `nas gap`; all if None
    rollout: int = 8192  # control steps between two updates of a policy
    minibatches: int = 32  # parts of a rollout, one gradient step each
    epochs: int = 10  # passes over a rollout
    arms: int = 16  # simulations stepped together
    ppo: str = OURS  # name of the set of the last four values, one of `PPO`

    @property
    def quick(self) -> bool:
        """Whether these sizes are smaller than the full experiment's."""
        return self.name != "full"

    @property
    def policies(self) -> str:
        """Folder of policies of these sizes, below that of all policies."""
        return f"{self.frames}" if self.ppo == OURS else f"{self.frames}-ppo-{self.ppo}"

    def with_ppo(self, name: str) -> "Sizes":
        """Return these sizes with another PPO.

        Raises:
            UnknownName: the name is unknown; the message lists the known ones.
        """
        if name not in PPO:
            raise UnknownName("PPO", name, PPO)
        return replace(self, ppo=name, **PPO[name])  # type: ignore[arg-type]  # dataclasses.replace is not generic over fields

    def with_counts(self, counts: tuple[int, ...]) -> "Sizes":
        """Return these sizes with other numbers of trajectories, each once and in order, all drawn from one recording.

        The recording has the size of the largest default number, or more if a larger one is requested. Numbers that are
        added later use the same recording.
        """
        chosen = tuple(sorted(set(counts))) or self.counts  # file names list them
        return replace(self, counts=chosen, trajectories=max((*counts, *self.counts)))

    def recipe(self, environment: str, dynamics: str, engine: str = "mujoco") -> Recipe:
        """Return the recording recipe of an environment's target."""
        known = RECORDINGS.get(find_task_file(environment)) or RecordingSize(250, find_task(environment).horizon, 1, 20)
        count = self.trajectories or known.trajectories
        return Recipe(
            environment=environment,
            dynamics=dynamics,
            episodes=count,
            steps=known.steps,
            holds=(known.hold,),
            varied=known.longest,
            engine=engine,
        )

    def phi(self, environment: str) -> TrainingOptions:
        """Return the training options of an environment's φ."""
        return self.delta if self.quick else PHI.get(find_task_file(environment), self.delta)

    def sentence(self) -> str:
        """Return a note on the sizes of a quick run, for tables; empty for a full one."""
        if not self.quick:
            return ""
        return (
            f"QUICK: a trial run, not a result: {self.trajectories} recorded trajectories, networks of "
            f"{self.delta.layers} × {self.delta.hidden} units after {self.delta.updates} updates, policies of "
            f"{count_of(self.frames, 'frame', ',')}, {count_of(len(self.seeds), 'seed')}, "
            f"{count_of(self.judged, 'episode')} each."
        )


# Twice the windows of the preset per update, six times its updates at twice its rate, discounted gradients along a
# window, and averaged weights, because policies need an accurate φ. Patience ends a φ on good names early, which has
# nothing left to learn.
LEARNING = preset(
    "fast",
    updates=2400,
    horizon=100,
    frames=6400,
    free_rate=4e-3,
    weight_decay=0.1,
    average=0.99,
    discount=0.95,
    patience=20,
)

# Play throws Striker's arm to and fro: two rollouts whose starts are a millionth of a radian apart are a degree apart
# after 5 s, so that gradients along windows are noise. Single steps along what was measured teach φ more, but not ψ
PHI: Mapping[str, TrainingOptions] = {"striker": replace(LEARNING, updates=0, epochs=24, batch=64, rate=4e-3)}


FULL = Sizes(
    name="full",
    heldout=100,
    delta=LEARNING,
    forward=LEARNING,
    presets={name: preset(name) for name in FOR_FEW},
    frames=2_000_000,
    seeds=(0, 1, 2, 3, 4),
    judged=100,
    counts=(10, 25, 50, 100, 250, 500, 1000, 2000),
)

# A run of minutes: every stage, table and figure works, but networks and policies have hardly learned.
QUICK = Sizes(
    name="quick",
    heldout=12,
    delta=preset("fast", hidden=32, layers=1, updates=60, horizon=50, frames=1600),
    forward=preset("fast", hidden=32, layers=1, updates=60, horizon=50, frames=1600),
    presets={name: preset(name, hidden=32, updates=60, frames=1600) for name in FOR_FEW},
    frames=40_000,
    seeds=(0, 1),
    judged=20,
    counts=(10, 20, 40),
    trajectories=40,
    named=8,
    rollout=2048,
    minibatches=8,
)
