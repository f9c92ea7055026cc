"""Record episodes from a simulated target: a robot with any effects, noise and quantisation."""

import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from nas_data.commands._actuators import TakesModel
from nas_data.commands.base import CommandResult
from nas_data.errors import OptionError

if TYPE_CHECKING:
    from nas_data.recorders.readings import Readings
    from nas_data.recorders.session import PlaybackProtocol, Target
    from nas_data.robots.base import Robot

FASTEST = 100_000.0  # [Hz] beyond any robot's control rate
LONGEST = 86_400.0  # [s] an episode of a day
PATIENCE = 2.0  # [s] of silence between two reports


@dataclass(frozen=True, kw_only=True)
class RecordSim(TakesModel):
    """Record episodes from a simulated target into a new dataset version.

    Example: nas record sim --robot ergojr --effect backlash:joint=m3,half_width=0.02 --episodes 200 --seconds 3

    Example: nas record sim --env Pusher --dynamics backlash --excitation babbling --episodes 250
    """

    robot: str = "ergojr"
    """A robot's name, or any MJCF or URDF file."""
    env: str | None = None
    """An environment instead: its robot and rate, its own starts, objects placed, and a signal in its action space."""
    dynamics: str = "backlash"
    """What the target is, for --env: one of the environment's dynamics."""
    engine: Literal["mujoco", "bullet"] = "mujoco"
    """Physics engine of the target."""
    effect: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    """An effect that the target has, NAME:joint=JOINT,PARAMETER=NUMBER; may be given several times."""
    effects: Path | None = None
    """A file of effects, such as the effects.json of a gap report."""
    excitation: str = "steps"
    """Command signal, NAME or NAME:PARAMETER=NUMBER,…: steps, babbling, ramps, sine, multisine, triangle or chirp."""
    commands: Path | None = None
    """Play a CSV file instead: columns <joint>.pos (or .vel, .effort, as the model takes them), perhaps 'episode'."""
    episodes: int = 200
    """Number of episodes."""
    seconds: float | None = None
    """Length of an episode [s]; 3, or an environment's own, where not given."""
    rate: float | None = None
    """Control rate [Hz]; the robot's own where not given."""
    start: Literal["rest", "random"] = "rest"
    """First pose: the robot's rest, or random within a fifth of each range as in the paper's resets."""
    noise: float = 0.0
    """Standard deviation of the measured positions [rad]."""
    quantum: float | None = None
    """Resolution of the measured positions [rad]; 0 for exact readings, the robot's own where not given."""
    velocity_noise: float = 0.0
    """Standard deviation of the measured velocities [rad/s]."""
    joints: tuple[str, ...] = ()
    """Move only these joints, the others resting; all by default."""
    seed: int = 0
    """Seed of commands, poses and noise."""
    blind: bool = False
    """Keep the effects out of the dataset's provenance, for tests in which they are to be found."""
    name: str | None = None
    """Name of the dataset: the next version of datasets/NAME; ROBOT_EXCITATION where not given."""
    out: Path | None = None
    """Write to exactly this folder instead."""

    def run(self) -> CommandResult:
        """Record and write the dataset."""
        from nas_data.dataset.content import content_hash
        from nas_data.dataset.versions import check_place, save
        from nas_data.recorders.session import RecordingSession
        from nas_data.recorders.simulated import record, to_dataset

        began = time.monotonic()
        session = RecordingSession.draw(self._target(), self._protocol())
        name = self.name or f"{session.target.robot.name}_{session.task}"
        check_place(out=self.out, name=name)
        dataset = to_dataset(session, record(session, SimulationProgress(len(session.commands))))
        path = save(dataset, session.provenance(self.blind), out=self.out, name=name)
        took = time.monotonic() - began
        text = (
            f"Recorded {dataset.n_episodes} episodes of {dataset.robot_type}, {dataset.n_frames} frames at "
            f"{dataset.fps:g} Hz ({dataset.n_frames / dataset.fps:.0f} s of motion), in {took:.1f} s.\n{path}"
        )
        data = {
            "dataset": str(path),
            "episodes": dataset.n_episodes,
            "frames": dataset.n_frames,
            "fps": dataset.fps,
            "seconds": took,
            "content_hash": content_hash(dataset),
        }
        return CommandResult(text, data)

    def _target(self) -> "Target":
        """Build the target and its sensors."""
        from nas_data.effects.base import parse
        from nas_data.gap.named import Named
        from nas_data.recorders.session import Target
        from nas_data.robots.base import find_robot
        from nas_data.simulators.engines import load_simulator

        if self.env is not None:
            return self._environment(self.env)
        robot = find_robot(self.actuated(self.robot))
        rate = robot.rate if self.rate is None else self.rate
        if not 0 < rate <= FASTEST:
            raise OptionError(f"--rate is {rate}; it must lie above 0 and up to {FASTEST:g} Hz.")
        named = Named.read(self.effects) if self.effects else None
        effects = [*(named.effects if named else ()), *map(parse, self.effect)]
        target = named.robot(robot, robot.joints) if named else robot
        simulator = load_simulator(target, 1 / rate, effects=effects, engine=self.engine)
        return Target(robot, simulator, self._readings(robot), rate)

    def _environment(self, name: str) -> "Target":
        """Build an environment's target and its sensors."""
        from nas_data.envs.base import find_task
        from nas_data.recorders.session import Target
        from nas_data.simulators.engines import load_simulator

        own: dict[str, object] = {"rate": self.rate, "effect": self.effect, "effects": self.effects}
        own |= {"joints": self.joints, "actuators": self.actuators != "position"}
        given = [option for option, value in own.items() if value]
        if given or self.start != "rest":
            raise OptionError(f"--{(given or ['start'])[0]} does not go with --env: the environment brings its own.")
        task = find_task(name)
        robot, effects = task.body(self.dynamics)
        simulator = load_simulator(robot, task.period, task.joints, effects, self.engine)
        return Target(robot, simulator, self._readings(robot), 1 / task.period)

    def _readings(self, robot: "Robot") -> "Readings":
        """Say how the sensors show the state."""
        from nas_data.recorders.readings import Readings

        return Readings(
            noise=self.noise,
            quantum=robot.position_quantum if self.quantum is None else self.quantum,
            velocity_noise=self.velocity_noise,
            # whoever asks for exact positions does not want a coarse velocity register either
            velocity_quantum=0.0 if self.quantum == 0 else robot.velocity_quantum,
        )

    def _protocol(self) -> "PlaybackProtocol":
        """Say what is to be played."""
        from nas_data.environment_ids import environment_id
        from nas_data.envs.base import find_task_file
        from nas_data.excitations.base import parse
        from nas_data.recorders.session import PlaybackProtocol, check_amount

        seconds = self._seconds()
        check_amount(self.episodes, seconds, LONGEST)
        return PlaybackProtocol(
            excitation=parse(self.excitation),
            file=self.commands,
            episodes=self.episodes,
            seconds=seconds,
            start=self.start,
            seed=self.seed,
            joints=self.joints,
            environment=environment_id(find_task_file(self.env)) if self.env else "",
        )

    def _seconds(self) -> float:
        """Return the length of an episode [s]."""
        if self.seconds is not None or self.env is None:
            return 3.0 if self.seconds is None else self.seconds
        from nas_data.envs.base import find_task

        task = find_task(self.env)
        return task.horizon * task.period


class SimulationProgress:
    """Says on stderr how many episodes are recorded, once recording takes long."""

    def __init__(self, episodes: int) -> None:
        self.episodes = episodes
        self.said = time.monotonic()

    def __call__(self, done: int) -> None:
        """Report, at most every two seconds."""
        if time.monotonic() - self.said > PATIENCE:
            self.said = time.monotonic()
            print(f"recorded {done} of {self.episodes} episodes", file=sys.stderr)
