"""Recording recipe: random actions on an environment's target, with duration, strength and smoothness by episode."""

from dataclasses import dataclass, replace
from itertools import cycle, islice

import numpy as np

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.provenance import Provenance
from nas_data.environment_ids import make_environment_id
from nas_data.envs.base import find_task, find_task_file
from nas_data.excitations.babbling import Babbling
from nas_data.excitations.base import Excitation
from nas_data.excitations.ramps import Ramps
from nas_data.recorders.readings import Readings
from nas_data.recorders.session import PlaybackProtocol, RecordingSession, Target, as_stored, draw_environment_starts
from nas_data.recorders.simulated import record, to_dataset
from nas_data.simulators.engines import load_simulator

PROTOCOL_INTERVAL = 4  # every fourth episode of a varied recipe follows `holds`
BRIEFEST, WEAKEST = 2, 0.2  # least duration [control steps] and least share of the range of a drawn action
KINDS = 1  # random stream of the kinds, apart from those of actions, starts and noise


@dataclass(frozen=True)
class CommandKind:
    """How the actions of an episode are drawn.

    Attributes:
        every: Duration of each action [control steps].
        strength: Share of the action range that is used.
        smooth: Whether actions are joined by ramps instead of held.
    """

    every: int
    strength: float = 1.0
    smooth: bool = False

    @classmethod
    def draw(cls, rng: np.random.Generator, longest: int) -> "CommandKind":
        """Draw duration (log-uniform, up to `longest` control steps), strength and smoothness."""
        every = round(float(np.exp(rng.uniform(np.log(BRIEFEST), np.log(longest)))))
        return cls(every, float(rng.uniform(WEAKEST, 1.0)), bool(rng.integers(2)))

    def signal(self) -> Excitation:
        """Return the excitation that draws the actions."""
        return Ramps(every=self.every) if self.smooth else Babbling(every=self.every)


@dataclass(frozen=True, kw_only=True)
class Recipe:
    """Episodes with an environment's starts, objects included, under uniformly random actions.

    Attributes:
        environment: Its name.
        dynamics: Name of the environment's dynamics that is the target.
        episodes: Number of episodes.
        steps: Control steps of each episode.
        holds: Duration of an action [control steps]; the episodes take these values in turn. Long actions move the arm
            far, as trained policies do. Short actions resemble exploration.
        seed: Seed of actions, starts and noise.
        varied: Longest action [control steps] in the three of four episodes that draw duration, strength and
            smoothness; 0 for no such episodes. Policies with an effort cost push weakly and for long, where friction
            and backlash matter most. Slow commands show behaviour that steps hide.
        engine: Physics engine of the target, `mujoco` or `bullet`.
    """

    environment: str
    dynamics: str
    episodes: int
    steps: int
    holds: tuple[int, ...]
    seed: int = 0
    varied: int = 0
    engine: str = "mujoco"

    def target(self) -> Target:
        """Return the environment's target with its robot's sensor resolution."""
        task = find_task(self.environment)
        robot, effects = task.body(self.dynamics)
        readings = Readings(quantum=robot.position_quantum, velocity_quantum=robot.velocity_quantum)
        simulator = load_simulator(robot, task.period, task.joints, effects, self.engine)
        return Target(robot, simulator, readings, rate=1 / task.period)

    def kinds(self) -> list[CommandKind]:
        """Return the kind of actions of each episode. It does not depend on the number of episodes."""
        kinds = [CommandKind(hold) for hold in islice(cycle(self.holds), self.episodes)]
        if not self.varied:
            return kinds
        rng = np.random.default_rng([self.seed, KINDS])
        drawn = [CommandKind.draw(rng, self.varied) for _ in kinds]
        return [kinds[k // PROTOCOL_INTERVAL] if k % PROTOCOL_INTERVAL == 0 else drawn[k] for k in range(self.episodes)]

    def session(self) -> RecordingSession:
        """Draw actions and starts, from separate random streams."""
        task = find_task(self.environment)
        command_rng, pose_rng, noise_rng = np.random.default_rng(self.seed).spawn(3)
        span = np.ones(task.action_space.shape[0])
        actions = [
            kind.strength * kind.signal().shape(command_rng, 1, self.steps, task.period, span)[0]
            for kind in self.kinds()
        ]
        protocol = PlaybackProtocol(
            excitation=Babbling(every=self.holds[0]),
            episodes=self.episodes,
            seconds=self.steps * task.period,
            seed=self.seed,
            environment=make_environment_id(find_task_file(self.environment)),
        )
        starts = draw_environment_starts(self.environment, self.episodes, pose_rng)
        commands = [as_stored(task.command(rows)) for rows in actions]
        return RecordingSession(self.target(), protocol, commands, starts, noise_rng)

    def record(self) -> tuple[Dataset, Provenance]:
        """Play the session; return the recording and its provenance."""
        session = self.session()
        held = ", ".join(str(hold) for hold in self.holds)
        notes = f"Random actions of {self.environment}, held for {held} control steps in turn, episode by episode."
        if self.varied:
            notes += (
                f" Three of four episodes do otherwise: actions last up to {self.varied} control steps, from a drawn "
                f"share of their range ({WEAKEST:g} to 1), and are held or, in every other one, joined by ramps."
            )
        return to_dataset(session, record(session)), replace(session.provenance(), notes=notes)
