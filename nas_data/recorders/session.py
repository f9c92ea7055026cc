"""Recording sessions in simulation: target, protocol, and everything drawn before the first command."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from nas_data.command_file import check_limits, read_commands
from nas_data.count_of import count_of
from nas_data.dataset.features import POSITION
from nas_data.dataset.provenance import Provenance
from nas_data.errors import JointMismatch, OptionError
from nas_data.excitations.base import Excitation
from nas_data.recorders.readings import Readings
from nas_data.robots.base import Robot
from nas_data.simulators.base import Simulator
from nas_data.simulators.limits import (
    command_limits,
    command_radians,
    find_excitable_limits,
    find_rest_pose,
    position_limits,
)

SETTLE = 0.5  # [s] for which the first pose is held before the recording starts
RESET_SHARE = 0.2  # part of each joint's range in which the paper's resets draw a pose


@dataclass(frozen=True)
class Target:
    """The simulated robot that is recorded.

    Attributes:
        robot: Model and constants.
        simulator: The robot with its effects, on its engine.
        readings: Its sensors.
        rate: Control rate [Hz], the inverse of the simulator's period.
    """

    robot: Robot
    simulator: Simulator
    readings: Readings
    rate: float

    def limits(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the lowest and highest command of each joint [rad or N·m], shape (n,); infinite where unlimited."""
        return command_limits(self.robot.spec().compile(), self.simulator.joints, str(self.robot.mjcf))

    def rest_pose(self) -> np.ndarray:
        """Return the robot's rest pose, else the pose closest to zero within the ranges [rad; m], shape (n,)."""
        return find_rest_pose(self.robot, self.robot.spec().compile())

    def describe(self, blind: bool) -> dict[str, object]:
        """Return the target for provenance; `blind` omits its effects."""
        description = {**self.simulator.describe(), **vars(self.readings)}
        return {key: value for key, value in description.items() if not (blind and key == "effects")}


@dataclass(frozen=True, kw_only=True)
class PlaybackProtocol:
    """The commands and starts to play.

    Attributes:
        excitation: Command signal.
        file: Commands to play instead.
        episodes: Number of episodes.
        seconds: Length of each [s].
        start: First pose, `rest` or `random` as in the paper's resets.
        seed: Seed of commands, poses and noise.
        noise_seed: Seed of the noise alone, for the same motion with other noise; None for `seed`.
        joints: Joints that the excitation moves while the others rest; empty for all.
        environment: Environment that supplies starts and actions instead; empty for none.
    """

    excitation: Excitation
    file: Path | None = None
    episodes: int = 1
    seconds: float = 3.0
    start: str = "rest"
    seed: int = 0
    noise_seed: int | None = None
    joints: tuple[str, ...] = ()
    environment: str = ""

    def __post_init__(self) -> None:
        for option, seed in (("seed", self.seed), ("noise-seed", self.noise_seed)):
            if seed is not None and seed < 0:
                raise OptionError(f"--{option} is {seed}; it must be 0 or more.")
        if self.file and self.joints:
            raise OptionError(
                f"--joints has no effect on the commands of {self.file}, which move all joints: leave it out, or let "
                "the other joints rest in the file."
            )

    def signal(self) -> dict[str, object]:
        """Return the command signal for provenance."""
        played = self.excitation.to_json()
        if self.file:
            played = {"file": self.file.name, "sha256": hashlib.sha256(self.file.read_bytes()).hexdigest()}
        return {**played, "start": self.start, "joints": list(self.joints)}


def check_amount(episodes: int, seconds: float, longest: float) -> None:
    """Refuse episodes that cannot be recorded.

    Args:
        episodes: Number of episodes.
        seconds: Length of each [s].
        longest: Largest allowed length [s].

    Raises:
        OptionError: there are no episodes, or they are too long.
    """
    if episodes < 1 or not 0 < seconds <= longest:
        raise OptionError(
            f"{count_of(episodes, 'episode')} of {seconds} s cannot be recorded; at least one is needed, of up to "
            f"{longest:g} s."
        )


@dataclass(frozen=True)
class RecordingSession:
    """Everything that was drawn before the first command is sent.

    Attributes:
        target: The simulated robot.
        protocol: Commands and starts to play.
        commands: Commands of each episode [rad or N·m], shape (T, n); T may differ.
        starts: First state of each episode, positions [rad] then velocities [rad/s] and objects, shape (E, 2n + m).
        rng: Source of the sensors' noise.
    """

    target: Target
    protocol: PlaybackProtocol
    commands: Sequence[np.ndarray]
    starts: np.ndarray
    rng: np.random.Generator

    @classmethod
    def draw(cls, target: Target, protocol: PlaybackProtocol) -> "RecordingSession":
        """Draw commands and poses, from separate random streams: noise does not change the commands.

        Raises:
            LogError, JointMismatch, OptionError: the command file does not fit the robot.
        """
        command_rng, pose_rng, noise_rng = np.random.default_rng(protocol.seed).spawn(3)
        if protocol.noise_seed is not None:
            noise_rng = np.random.default_rng(protocol.noise_seed).spawn(3)[2]
        commands = [as_stored(rows) for rows in draw_commands(target, protocol, command_rng)]
        starts = draw_starts(target, protocol, len(commands), pose_rng)
        return cls(target, protocol, commands, starts, noise_rng)

    @property
    def settled(self) -> float:
        """Time for which the first pose is held before the recording [s]; 0 for an environment's episodes."""
        return 0.0 if self.protocol.environment else SETTLE

    @property
    def task(self) -> str:
        """Name of the task of every episode."""
        return self.protocol.file.stem if self.protocol.file else self.protocol.excitation.name()

    def provenance(self, blind: bool = False) -> Provenance:
        """Return the provenance of the dataset; `blind` omits the target's effects."""
        environment = self.protocol.environment
        own = {"start": "environment", "environment": environment} if environment else {}
        return Provenance(
            how="simulated",
            robot=self.target.robot.name,
            target={**self.target.describe(blind), "settled": self.settled},
            signal={**self.protocol.signal(), **own},
            seeds=tuple(seed for seed in (self.protocol.seed, self.protocol.noise_seed) if seed is not None),
            contiguous=True,
        )


def as_stored(commands: np.ndarray) -> np.ndarray:
    """Round commands to single precision, so that the played and the stored commands are bit-equal."""
    return commands.astype(np.float32).astype(float)


def draw_commands(target: Target, protocol: PlaybackProtocol, rng: np.random.Generator) -> list[np.ndarray]:
    """Return the commands of each episode, shape (T, n), drawn or read from a file."""
    simulator = target.simulator
    low, high = target.limits()
    if protocol.file:
        names = [joint + kind for joint, kind in zip(simulator.joints, simulator.kinds, strict=True)]
        commands = read_commands(protocol.file, names)
        check_limits(protocol.file, names, commands, low, high)
        return commands
    steps = max(1, round(protocol.seconds / simulator.period))
    if protocol.environment:
        return draw_actions(protocol.environment, protocol.excitation, protocol.episodes, steps, rng)
    low, high = find_excitable_limits(low, high, simulator.joints, simulator.kinds, simulator.slides)
    radians = command_radians(simulator, low, high)
    still = find_resting_joints(target, protocol)
    rest = np.where([kind == POSITION for kind in simulator.kinds], target.rest_pose(), 0.0)
    low, high = np.where(still, rest, low), np.where(still, rest, high)
    return list(protocol.excitation.commands(rng, protocol.episodes, steps, simulator.period, low, high, radians))


def find_resting_joints(target: Target, protocol: PlaybackProtocol) -> np.ndarray:
    """Return the mask of joints that the excitation leaves at rest, shape (n,).

    Raises:
        JointMismatch: the protocol moves a joint that the robot lacks.
    """
    joints = target.simulator.joints
    unknown = [joint for joint in protocol.joints if joint not in joints]
    if unknown:
        raise JointMismatch(f"The robot has no joint '{unknown[0]}' to move; it has: {', '.join(joints)}.")
    return np.array([bool(protocol.joints) and joint not in protocol.joints for joint in joints])


def draw_starts(target: Target, protocol: PlaybackProtocol, episodes: int, rng: np.random.Generator) -> np.ndarray:
    """Return the first state of each episode, shape (E, 2n + m): an environment's own, or a pose at rest."""
    if protocol.environment:
        return draw_environment_starts(protocol.environment, episodes, rng)
    poses = draw_poses(target, protocol, episodes, rng)
    states = np.concatenate([poses, np.zeros_like(poses)], axis=1)
    if not target.simulator.object_feature.width:
        return states
    return np.concatenate([states, np.tile(target.simulator.stepper(1).objects, (episodes, 1))], axis=1)


def draw_poses(target: Target, protocol: PlaybackProtocol, episodes: int, rng: np.random.Generator) -> np.ndarray:
    """Return the first pose of each episode [rad], shape (E, n)."""
    joints = target.simulator.joints
    if protocol.start == "rest":
        return np.tile(target.rest_pose(), (episodes, 1))
    low, high = target.limits()
    # Limits of torques and velocities are not positions: such joints start near zero.
    positional = np.array([kind == POSITION for kind in target.simulator.kinds])
    low, high = np.where(positional, low, -np.inf), np.where(positional, high, np.inf)
    model = target.robot.spec().compile()
    for joint in target.simulator.slides:
        place, index = joints.index(joint), int(model.joint(joint).id)
        if not np.isfinite(high[place] - low[place]):
            low[place], high[place] = model.jnt_range[index] if model.jnt_limited[index] else (0.0, 0.0)
    low, high = find_excitable_limits(low, high, joints, [POSITION] * len(joints))
    middle, span = (low + high) / 2, (high - low) / 2
    drawn = middle + RESET_SHARE * span * rng.uniform(-1, 1, (episodes, len(joints)))
    drawn = np.clip(drawn, *position_limits(model, joints, str(target.robot.mjcf)))
    return np.where(find_resting_joints(target, protocol), target.rest_pose(), drawn)


def draw_actions(
    environment: str, excitation: Excitation, episodes: int, steps: int, rng: np.random.Generator
) -> list[np.ndarray]:
    """Draw the commands of an excitation in the action space.

    Args:
        environment: Name of the environment.
        excitation: Signal, scaled to the whole action space.
        episodes: Number of episodes, E.
        steps: Control steps of each, T.
        rng: Source of randomness.

    Returns:
        Positions [rad] or torques [N·m] of each episode, shape (T, n).
    """
    from nas_data.envs.base import find_task  # loads gymnasium, which few recordings need

    task = find_task(environment)
    low, high = task.action_space.low.astype(float), task.action_space.high.astype(float)
    return [task.command(rows) for rows in excitation.commands(rng, episodes, steps, task.period, low, high)]


def draw_environment_starts(environment: str, episodes: int, rng: np.random.Generator) -> np.ndarray:
    """Draw initial states, shape (E, 2n + m): positions [rad], velocities [rad/s], then states of objects."""
    from nas_data.envs.base import find_task  # loads gymnasium, which few recordings need

    task = find_task(environment)
    starts = [task.start(rng) for _ in range(episodes)]
    return np.stack([np.concatenate([start.state, start.objects]) for start in starts])
