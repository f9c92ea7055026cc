"""Record episodes from a simulated target: a robot with any effects, noise and quantisation."""

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from nas_data.commands._actuators import TakesModel
from nas_data.commands.base import CommandResult
from nas_data.count_of import count_of
from nas_data.environment_ids import TARGET_DYNAMICS
from nas_data.runs.progress import PAUSE, RateLimited, begin


@dataclass(frozen=True, kw_only=True)
class RecordSim(TakesModel):
    """Record episodes from a simulated target into a new dataset version.

    Example: nas record sim --robot ergojr --effect backlash:joint=m3,half_width=0.02 --episodes 200 --seconds 3

    Example: nas record sim --env Pusher --dynamics backlash --excitation babbling --episodes 250
    """

    robot: str = "ergojr"
    """A robot's name, or any MJCF or URDF file."""
    env: str | None = None
    """An environment instead of a robot: its model, rate, initial states, objects, and commands in its action space."""
    dynamics: str = TARGET_DYNAMICS
    """Dynamics of the target with --env, such as backlash or paper; an unknown name lists all."""
    engine: Literal["mujoco", "bullet"] = "mujoco"
    """Physics engine of the target."""
    effect: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    """An effect of the target, NAME:joint=JOINT,PARAMETER=NUMBER; may be given several times."""
    effects: Path | None = None
    """A file of effects, such as the effects.json of a gap report. None by default."""
    excitation: str = "steps"
    """Command signal, NAME or NAME:PARAMETER=NUMBER,…, such as steps or ramps:every=20; a wrong NAME or PARAMETER is
    answered with those that exist."""
    commands: Path | None = None
    """Play a CSV file instead: columns <joint>.pos (or .vel, .effort, as the model takes), optionally 'episode'."""
    episodes: int = 200
    """Number of episodes."""
    seconds: float | None = None
    """Length of an episode [s]; 3 by default, or the environment's."""
    rate: float | None = None
    """Control rate [Hz]; the robot's by default."""
    start: Literal["rest", "random"] = "rest"
    """First pose: the robot's rest pose, or random within a fifth of each range as in the paper's resets."""
    noise: float = 0.0
    """Standard deviation of the measured positions [rad]."""
    quantum: float | None = None
    """Resolution of the measured positions [rad]; 0 for exact readings, the robot's by default."""
    velocity_noise: float = 0.0
    """Standard deviation of the measured velocities [rad/s]."""
    joints: tuple[str, ...] = ()
    """Move only these joints; the others hold their rest position. All by default."""
    seed: int = 0
    """Seed of commands, poses and noise."""
    noise_seed: int | None = None
    """Seed of the noise alone, for the same motion with other noise; that of --seed by default."""
    blind: bool = False
    """Omit the effects from the dataset's provenance, to test whether they are found."""
    name: str | None = None
    """Name of the dataset: the next version of datasets/NAME; ROBOT_EXCITATION by default."""
    out: Path | None = None
    """Write to exactly this folder instead of a version of datasets/NAME."""

    def run(self) -> CommandResult:
        """Record and write the dataset."""
        from nas_data.api.recording import record
        from nas_data.dataset.content import hash_content
        from nas_data.dataset.origin import describe
        from nas_data.dataset.versions import check_destination, make_name, save

        began = time.monotonic()
        check_destination(out=self.out, name=self.name or "dataset")
        begin("simulating")
        dataset = record(
            self.robot,
            env=self.env,
            dynamics=self.dynamics,
            effects=self.effect,
            report=self.effects,
            excitation=self.excitation,
            commands=self.commands,
            episodes=self.episodes,
            seconds=self.seconds,
            rate=self.rate,
            start=self.start,
            joints=self.joints,
            noise=self.noise,
            quantum=self.quantum,
            velocity_noise=self.velocity_noise,
            seed=self.seed,
            noise_seed=self.noise_seed,
            blind=self.blind,
            engine=self.engine,
            actuators=self.actuators,
            progress=RateLimited(first=PAUSE),
        )
        provenance, _ = describe(dataset)
        name = self.name or make_name(f"{dataset.robot_type}_{dataset.tasks[0]}")
        begin("writing the dataset")
        path = save(dataset, provenance, out=self.out, name=name)
        took = time.monotonic() - began
        text = (
            f"Recorded {count_of(dataset.n_episodes, 'episode')} of {dataset.robot_type}, "
            f"{count_of(dataset.n_frames, 'frame')} at "
            f"{dataset.fps:g} Hz ({dataset.n_frames / dataset.fps:.1f} s of motion), in {took:.1f} s.\n{path}"
        )
        data = {
            "dataset": str(path),
            "episodes": dataset.n_episodes,
            "frames": dataset.n_frames,
            "fps": dataset.fps,
            "seconds": took,
            "content_hash": hash_content(dataset),
        }
        return CommandResult(text, data)
