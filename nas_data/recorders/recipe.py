"""A recording recipe: random actions on an environment's target, held for a longer or shorter time by episode."""

from dataclasses import dataclass, replace
from itertools import cycle, islice

import numpy as np

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.provenance import Provenance
from nas_data.envs.base import environment_id, find_task, find_task_file
from nas_data.excitations.babbling import Babbling
from nas_data.recorders.environment import draw_environment_starts
from nas_data.recorders.readings import Readings
from nas_data.recorders.session import Protocol, Session, Target, as_stored
from nas_data.recorders.simulated import record, to_dataset
from nas_data.simulators.engines import load_simulator


@dataclass(frozen=True, kw_only=True)
class Recipe:
    """Episodes that begin as an environment's do, objects placed, under uniformly random actions.

    Attributes:
        environment: Its name.
        dynamics: What the target is: one of the environment's dynamics.
        episodes: Number of episodes.
        steps: Control steps of each.
        holds: Control steps that an action is held, one number after the other episode by episode. Actions that are
            held long move the arm far, as policies do; actions that are held briefly are what exploring policies try.
        seed: Of actions, starts and noise.
        strengths: Shares of the actions' range that actions are drawn from, in turn like the holds. Policies that pay
            for effort push weakly and for long, where friction and play do what they never do under full torque.
    """

    environment: str
    dynamics: str
    episodes: int
    steps: int
    holds: tuple[int, ...]
    seed: int = 0
    strengths: tuple[float, ...] = (1.0,)

    def target(self) -> Target:
        """Return the environment's target with the sensors of its robot."""
        task = find_task(self.environment)
        robot, effects = task.body(self.dynamics)
        readings = Readings(quantum=robot.position_quantum, velocity_quantum=robot.velocity_quantum)
        return Target(robot, load_simulator(robot, task.period, task.joints, effects), readings, rate=1 / task.period)

    def kinds(self) -> list[tuple[int, float]]:
        """Return how long each episode's actions are held, and the share of their range that they are drawn from."""
        return list(islice(zip(cycle(self.holds), cycle(self.strengths), strict=False), self.episodes))

    def session(self) -> Session:
        """Draw actions and starts, from streams of their own."""
        task = find_task(self.environment)
        command_rng, pose_rng, noise_rng = np.random.default_rng(self.seed).spawn(3)
        span = np.ones(task.action_space.shape[0])
        actions = [
            strength * Babbling(every=hold).shape(command_rng, 1, self.steps, task.period, span)[0]
            for hold, strength in self.kinds()
        ]
        protocol = Protocol(
            excitation=Babbling(every=self.holds[0]),
            episodes=self.episodes,
            seconds=self.steps * task.period,
            seed=self.seed,
            environment=environment_id(find_task_file(self.environment)),
        )
        starts = draw_environment_starts(self.environment, self.episodes, pose_rng)
        commands = [as_stored(task.command(rows)) for rows in actions]
        return Session(self.target(), protocol, commands, starts, noise_rng)

    def record(self) -> tuple[Dataset, Provenance]:
        """Play the session, and return the recording with where it comes from."""
        session = self.session()
        held = ", ".join(str(hold) for hold in self.holds)
        notes = f"Random actions of {self.environment}, held for {held} control steps in turn, episode by episode."
        if any(strength != 1 for strength in self.strengths):
            shares = ", ".join(f"{strength:g}" for strength in self.strengths)
            notes += f" Drawn from {shares} of their range, likewise."
        return to_dataset(session, record(session)), replace(session.provenance(), notes=notes)
