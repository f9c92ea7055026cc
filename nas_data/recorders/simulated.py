"""Episodes recorded from a simulated target: what a robot with that body and those sensors would have reported."""

import hashlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from nas_data.command_file import check_limits, read_commands
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import (
    ACTION,
    EFFORT,
    ENVIRONMENT,
    NEXT_ENVIRONMENT,
    NEXT_STATE,
    POSITION,
    STATE,
    TIME,
    effort_feature,
    position_feature,
    state_feature,
    time_feature,
)
from nas_data.dataset.provenance import Provenance
from nas_data.errors import JointMismatch, OptionError
from nas_data.excitations.base import Excitation
from nas_data.robots.base import Robot
from nas_data.simulators.base import Simulator
from nas_data.simulators.limits import command_limits, excitable_limits

SETTLE = 0.5  # [s] that the first pose is held before the recording starts
RESET_SHARE = 0.2  # part of each joint's range in which the paper's resets draw a pose
BATCH = 5000  # control steps simulated between two reports of progress


@dataclass(frozen=True, kw_only=True)
class Readings:
    """How a robot's sensors show its state: noise, then rounding to the sensor's resolution.

    Attributes:
        noise: Standard deviation of the position noise [rad].
        quantum: Resolution of the position [rad]; 0 for exact.
        velocity_noise: Standard deviation of the noise in the velocity register [rad/s].
        velocity_quantum: Resolution of the velocity register [rad/s]; 0 for exact.
    """

    noise: float = 0.0
    quantum: float = 0.0
    velocity_noise: float = 0.0
    velocity_quantum: float = 0.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not 0 <= value < math.inf:
                raise OptionError(f"{name.replace('_', ' ')} is {value}; it must be zero or more.")

    def of(self, states: np.ndarray, rng: np.random.Generator, joints: int | None = None) -> np.ndarray:
        """Return what is reported for states.

        Args:
            states: Positions [rad] then velocities [rad/s], shape (…, 2n); those of objects may follow, which are
                reported as they are.
            rng: Source of the noise.
            joints: n, where objects follow.
        """
        n = states.shape[-1] // 2 if joints is None else joints
        return np.concatenate(
            [
                reading(states[..., :n], self.noise, self.quantum, rng),
                reading(states[..., n : 2 * n], self.velocity_noise, self.velocity_quantum, rng),
                states[..., 2 * n :],
            ],
            axis=-1,
        )


def reading(values: np.ndarray, noise: float, quantum: float, rng: np.random.Generator) -> np.ndarray:
    """Return values with Gaussian noise, rounded to multiples of a quantum."""
    noisy = values + noise * rng.standard_normal(values.shape) if noise else values
    return np.round(noisy / quantum) * quantum if quantum else noisy


@dataclass(frozen=True)
class Target:
    """What stands in for the robot.

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

    def describe(self, blind: bool) -> dict[str, object]:
        """Return the target for provenance; blind leaves out its effects, which are to be found."""
        description = {**self.simulator.describe(), **vars(self.readings)}
        return {key: value for key, value in description.items() if not (blind and key == "effects")}


@dataclass(frozen=True, kw_only=True)
class Protocol:
    """What is played.

    Attributes:
        excitation: Command signal.
        file: Commands to play instead.
        episodes: Number of episodes.
        seconds: Length of each [s].
        start: First pose, `rest` or `random` as in the paper's resets.
        seed: Seed of commands, poses and noise.
        joints: Joints that the excitation moves, the others resting; all where empty.
        environment: Environment whose starts and actions are played instead, episode by episode; none where empty.
    """

    excitation: Excitation
    file: Path | None = None
    episodes: int = 1
    seconds: float = 3.0
    start: str = "rest"
    seed: int = 0
    joints: tuple[str, ...] = ()
    environment: str = ""

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise OptionError(f"--seed is {self.seed}; it must be 0 or more.")


@dataclass(frozen=True)
class Session:
    """Everything that was drawn before the first command is sent.

    Attributes:
        target: What is recorded.
        protocol: How.
        commands: Commands of each episode [rad or N·m], shape (T, n); T may differ.
        starts: First state of each episode, positions [rad] then velocities [rad/s] and objects, shape (E, 2n + m).
        rng: Source of the sensors' noise.
    """

    target: Target
    protocol: Protocol
    commands: Sequence[np.ndarray]
    starts: np.ndarray
    rng: np.random.Generator

    @classmethod
    def draw(cls, target: Target, protocol: Protocol) -> "Session":
        """Draw commands and poses, from streams of their own: more noise does not change the commands.

        Raises:
            LogError, JointMismatch, OptionError: the file of commands does not fit the robot.
        """
        command_rng, pose_rng, noise_rng = np.random.default_rng(protocol.seed).spawn(3)
        commands = [as_stored(rows) for rows in draw_commands(target, protocol, command_rng)]
        starts = draw_starts(target, protocol, len(commands), pose_rng)
        return cls(target, protocol, commands, starts, noise_rng)

    @property
    def settled(self) -> float:
        """How long [s] the first pose is held before the recording starts; an environment's episodes just begin."""
        return 0.0 if self.protocol.environment else SETTLE

    @property
    def task(self) -> str:
        """What every episode does, in a word."""
        return self.protocol.file.stem if self.protocol.file else self.protocol.excitation.name()

    def provenance(self, blind: bool = False) -> Provenance:
        """Return where the dataset comes from; blind leaves out the target's effects."""
        file = self.protocol.file
        signal = (
            {"file": file.name, "sha256": hashlib.sha256(file.read_bytes()).hexdigest()}
            if file
            else self.protocol.excitation.to_json()
        )
        return Provenance(
            how="simulated",
            robot=self.target.robot.name,
            target={**self.target.describe(blind), "settled": self.settled},
            signal={**signal, "start": self.protocol.start, "joints": list(self.protocol.joints)} | self._environment(),
            seeds=(self.protocol.seed,),
            contiguous=True,
        )

    def _environment(self) -> dict[str, object]:
        environment = self.protocol.environment
        return {"start": "environment", "environment": environment} if environment else {}


def as_stored(commands: np.ndarray) -> np.ndarray:
    """Round commands to single precision: what is played is then to the bit what the dataset says was played."""
    return commands.astype(np.float32).astype(float)


def draw_commands(target: Target, protocol: Protocol, rng: np.random.Generator) -> list[np.ndarray]:
    """Return the commands of each episode, shape (T, n), drawn or read from a file."""
    simulator = target.simulator
    low, high = target.limits()
    if protocol.file:
        names = [joint + (EFFORT if simulator.commands_effort else POSITION) for joint in simulator.joints]
        commands = read_commands(protocol.file, names)
        check_limits(protocol.file, names, commands, low, high)
        return commands
    steps = max(1, round(protocol.seconds / simulator.period))
    if protocol.environment:
        from nas_data.recorders.environment import draw_actions

        return draw_actions(protocol.environment, protocol.excitation, protocol.episodes, steps, rng)
    low, high = excitable_limits(low, high, simulator.joints, simulator.commands_effort)
    still = resting(target, protocol)
    rest = np.array(target.robot.rest or np.zeros(len(simulator.joints)))
    low, high = np.where(still, rest, low), np.where(still, rest, high)
    return list(protocol.excitation.commands(rng, protocol.episodes, steps, simulator.period, low, high))


def resting(target: Target, protocol: Protocol) -> np.ndarray:
    """Return which joints the excitation leaves at rest, shape (n,).

    Raises:
        JointMismatch: the protocol moves a joint that the robot lacks.
    """
    joints = target.simulator.joints
    unknown = [joint for joint in protocol.joints if joint not in joints]
    if unknown:
        raise JointMismatch(f"The robot has no joint '{unknown[0]}' to move; it has: {', '.join(joints)}.")
    return np.array([bool(protocol.joints) and joint not in protocol.joints for joint in joints])


def draw_starts(target: Target, protocol: Protocol, episodes: int, rng: np.random.Generator) -> np.ndarray:
    """Return the first state of each episode, shape (E, 2n + m): an environment's own, or a pose at rest."""
    if protocol.environment:
        from nas_data.recorders.environment import draw_environment_starts

        return draw_environment_starts(protocol.environment, episodes, rng)
    poses = draw_poses(target, protocol, episodes, rng)
    states = np.concatenate([poses, np.zeros_like(poses)], axis=1)
    if not target.simulator.object_feature.width:
        return states
    return np.concatenate([states, np.tile(target.simulator.stepper(1).objects, (episodes, 1))], axis=1)


def draw_poses(target: Target, protocol: Protocol, episodes: int, rng: np.random.Generator) -> np.ndarray:
    """Return the first pose of each episode [rad], shape (E, n)."""
    joints = target.simulator.joints
    if protocol.start == "rest":
        return np.tile(target.robot.rest or np.zeros(len(joints)), (episodes, 1))
    low, high = target.limits()
    if target.simulator.commands_effort:  # limits are torques; their joints start near zero
        low, high = np.full(len(joints), -np.pi / 2), np.full(len(joints), np.pi / 2)
    low, high = excitable_limits(low, high, joints, effort=False)
    middle, span = (low + high) / 2, (high - low) / 2
    drawn = middle + RESET_SHARE * span * rng.uniform(-1, 1, (episodes, len(joints)))
    return np.where(resting(target, protocol), np.array(target.robot.rest or np.zeros(len(joints))), drawn)


def record(session: Session, progress: Callable[[int], None] = lambda done: None) -> list[np.ndarray]:
    """Play a session's commands on its target and read the sensors.

    Each episode starts after the target has been commanded to its first pose for half a second; a target that takes
    torques starts in the pose, at rest. An environment's episodes begin where its own do.

    Args:
        session: What to play on what.
        progress: Told how many episodes are done.

    Returns:
        Readings of each episode before the first command and after each, shape (T + 1, 2n or 2n + m).
    """
    measured: list[np.ndarray] = []
    longest = max(len(episode) for episode in session.commands)
    count = max(1, BATCH // longest)
    for first in range(0, len(session.commands), count):
        commands = session.commands[first : first + count]
        batch = np.stack([hold_last(episode, longest) for episode in commands])
        simulator = session.target.simulator
        states = play(simulator, batch, session.starts[first : first + count], session.settled)
        readings = session.target.readings.of(states, session.rng, len(simulator.joints))
        measured += [row[: len(episode) + 1] for row, episode in zip(readings, commands, strict=True)]
        progress(len(measured))
    return measured


def hold_last(commands: np.ndarray, steps: int) -> np.ndarray:
    """Lengthen commands (T, n) to `steps` by repeating the last one."""
    return np.concatenate([commands, np.repeat(commands[-1:], steps - len(commands), axis=0)])


def play(simulator: Simulator, commands: np.ndarray, initial: np.ndarray, settle: float) -> np.ndarray:
    """Play commands from first states.

    Args:
        simulator: Target.
        commands: Positions [rad] or torques [N·m], shape (B, T, n).
        initial: Shape (B, 2n), or with objects (B, 2n + m).
        settle: How long [s] a first pose is held before; not where commands are torques.

    Returns:
        True states before and after each command, shape (B, T + 1, 2n or 2n + m).
    """
    if simulator.commands_effort or not settle:
        return np.concatenate([initial[:, None], simulator.rollout(initial, commands)], axis=1)
    steps = max(1, math.ceil(settle / simulator.period - 1e-9))
    held = np.repeat(initial[:, None, : commands.shape[2]], steps, axis=1)
    return simulator.rollout(initial, np.concatenate([held, commands], axis=1))[:, steps - 1 :]


def to_dataset(session: Session, measured: Sequence[np.ndarray]) -> Dataset:
    """Return recorded episodes as a dataset.

    Args:
        session: What was played on what.
        measured: Readings of each episode, shape (T + 1, 2n), or with objects (T + 1, 2n + m).
    """
    simulator = session.target.simulator
    joints, commands = simulator.joints, session.commands
    now = np.concatenate([episode[:-1] for episode in measured]).astype(np.float32)
    after = np.concatenate([episode[1:] for episode in measured]).astype(np.float32)
    n = len(joints)
    features = {
        STATE: state_feature(joints),
        ACTION: effort_feature(joints) if simulator.commands_effort else position_feature(joints),
        NEXT_STATE: state_feature(joints),
        TIME: time_feature(),
    }
    columns = {
        STATE: now[:, : 2 * n],
        ACTION: np.concatenate(commands).astype(np.float32),
        NEXT_STATE: after[:, : 2 * n],
        TIME: np.concatenate([np.arange(len(episode)) / session.target.rate for episode in commands])[:, None],
    }
    if now.shape[1] > 2 * n:
        features |= {ENVIRONMENT: simulator.object_feature, NEXT_ENVIRONMENT: simulator.object_feature}
        columns |= {ENVIRONMENT: now[:, 2 * n :], NEXT_ENVIRONMENT: after[:, 2 * n :]}
    return Dataset(
        features=features,
        columns=columns,
        lengths=np.array([len(episode) for episode in commands]),
        fps=session.target.rate,
        robot_type=session.target.robot.name,
        tasks=(session.task,) * len(commands),
    )
