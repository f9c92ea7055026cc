"""Collision-free commands of a recording, drawn and checked in simulation before the arm moves."""

import hashlib
import io
import json
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from nas_data.count_of import count_of
from nas_data.effects.base import Effect, make_effect
from nas_data.errors import OptionError
from nas_data.recorders.arm_motion import limit_step
from nas_data.recorders.path_planner import PathPlanner
from nas_data.recorders.readings import Readings
from nas_data.recorders.session import PlaybackProtocol, RecordingSession, Target
from nas_data.robots.base import Robot
from nas_data.simulators.contact import count_contacts
from nas_data.simulators.mujoco import MujocoSimulator

RETURN_SECONDS = 2.0  # [s] simulated after each episode: the return to the first pose must be collision-free, too
CHECK_INTERVAL = 0.03  # [s] between two collision checks of a motion
SEED_STEP = 1_000_003  # added to the seed for each new draw; too large to meet a seed that a user chose
ROUNDS = 50  # draws after which the request counts as impossible


@dataclass(frozen=True)
class MotionPlan:
    """Commands and first poses of every episode.

    Attributes:
        commands: [rad], shape (E, T, n).
        poses: First poses [rad], shape (E, n).
        task: Name of the task.
        replaced: Number of episodes that were drawn again because of a collision.
        key: Inputs of the plan; see `plan_key`.
    """

    commands: np.ndarray
    poses: np.ndarray
    task: str
    replaced: int
    key: str

    def to_bytes(self) -> bytes:
        """Return the plan as the bytes of an NPZ file."""
        stream = io.BytesIO()
        task, key = np.array(self.task), np.array(self.key)
        np.savez_compressed(
            stream, commands=self.commands, poses=self.poses, task=task, replaced=self.replaced, key=key
        )
        return stream.getvalue()

    @classmethod
    def from_bytes(cls, content: bytes) -> "MotionPlan":
        """Read a plan from the output of `to_bytes`."""
        stored = np.load(io.BytesIO(content))
        words = str(stored["task"]), int(stored["replaced"]), str(stored["key"])
        return cls(stored["commands"], stored["poses"], *words)


@dataclass(frozen=True)
class MotionLimits:
    """How fast commands come and servos move.

    Attributes:
        rate: Control rate [Hz].
        speed: Speed limit of the servos [rad/s]; 0 for none.
        largest_step: Largest difference between successive commands [rad]; slides scale it by `PathPlanner.radians`.
    """

    rate: float
    speed: float
    largest_step: float = np.inf


def plan_key(robot: Robot, protocol: PlaybackProtocol, limits: MotionLimits) -> str:
    """Return all inputs of a plan as one line of JSON: equal lines give equal plans."""
    file = hashlib.sha256(protocol.file.read_bytes()).hexdigest() if protocol.file else None
    values = {**vars(protocol), "excitation": protocol.excitation.to_json(), "file": file, **vars(limits)}
    return json.dumps({**values, "model": robot.sha256}, sort_keys=True)


def draw_plan(
    robot: Robot,
    protocol: PlaybackProtocol,
    limits: MotionLimits,
    progress: Callable[[int, int], None] = lambda *_: None,
) -> MotionPlan:
    """Draw episodes until the requested number is collision-free; those of a file are only checked.

    Args:
        robot: Model for the collision checks.
        protocol: Commands to draw or read.
        limits: Control rate and limits of commands and servos.
        progress: Called with the number of episodes found and the number requested.

    Raises:
        OptionError: an episode of a file collides, its episodes differ in length, or too few free ones can be drawn.
    """
    planner = PathPlanner(robot)
    effects = _make_speed_limits(robot, limits.speed * planner.radians)
    simulator = MujocoSimulator(robot, 1 / limits.rate, effects=effects, threads=1)
    target = Target(robot, simulator, Readings(), limits.rate)
    step = limits.largest_step * planner.radians
    commands, poses, fates = list[np.ndarray](), list[np.ndarray](), list[bool]()
    for attempt in range(ROUNDS):
        session = RecordingSession.draw(target, replace(protocol, seed=protocol.seed + attempt * SEED_STEP))
        wanted = protocol.episodes if protocol.file is None else len(session.commands)
        block = np.stack([_check_length(rows, session.commands[0]) for rows in session.commands])
        first = session.starts[:, : len(simulator.joints)]
        free = free_of_contact(simulator, block, first, planner, step)
        if protocol.file is not None and not free.all():
            raise OptionError(
                f"{protocol.file}: in episode {int(np.argmin(free))} the arm would touch itself or the floor; "
                "change those commands."
            )
        commands += list(block[free])
        poses += list(first[free])
        fates += free.tolist()
        progress(min(wanted, len(commands)), wanted)
        if len(commands) >= wanted:
            last = int(np.flatnonzero(fates)[wanted - 1])
            return MotionPlan(
                commands=np.stack(commands[:wanted]),
                poses=np.stack(poses[:wanted]),
                task=session.task,
                replaced=last + 1 - wanted,
                key=plan_key(robot, protocol, limits),
            )
    raise OptionError(
        f"Of {count_of(len(fates), 'episode')} of {session.task}, only {len(commands)} are free of contact with the "
        "arm itself and the floor; use "
        "less of the joints' range (--excitation NAME:share=0.5)."
    )


def free_of_contact(
    simulator: MujocoSimulator,
    commands: np.ndarray,
    poses: np.ndarray,
    planner: PathPlanner,
    step: np.ndarray | float = np.inf,
) -> np.ndarray:
    """Return a mask of the collision-free episodes, shape (E,).

    The return to the first pose and the slow paths from and to the rest pose count as well.

    Args:
        simulator: Simulation of the arm.
        commands: [rad], shape (E, T, n).
        poses: First poses [rad], shape (E, n).
        planner: Checks the slow paths.
        step: Largest difference between successive commands [rad; m], one for all or shape (n,).
    """
    n, steps = poses.shape[1], commands.shape[1]
    back = np.repeat(poses[:, None], round(RETURN_SECONDS / simulator.period), axis=1)
    initial = np.concatenate([poses, np.zeros_like(poses)], axis=1)
    sent = limit_steps(np.concatenate([commands, back], axis=1), poses, step)
    path = simulator.rollout(initial, sent)[..., :n]
    seen = path[:, :: max(1, round(CHECK_INTERVAL / simulator.period))]
    counts = count_contacts(simulator, seen.reshape(-1, n)).reshape(len(poses), -1)
    free = np.asarray((counts == 0).all(axis=1) & (count_contacts(simulator, poses) == 0))
    for episode in np.flatnonzero(free):
        last, first = path[episode, steps - 1], poses[episode]
        free[episode] = planner.exists(last, planner.rest) and planner.exists(planner.rest, first)
    return free


def limit_steps(commands: np.ndarray, poses: np.ndarray, step: np.ndarray | float) -> np.ndarray:
    """Return commands as an arm sends them [rad; m], shape (E, T, n): none differs from the one before by more.

    Args:
        commands: Wanted commands [rad; m], shape (E, T, n).
        poses: Commands before the first ones [rad; m], shape (E, n).
        step: Largest difference [rad; m], one for all or shape (n,).
    """
    sent, last = np.empty_like(commands), poses
    for number in range(commands.shape[1]):
        sent[:, number] = last = limit_step(commands[:, number], last, step)
    return sent


def _make_speed_limits(robot: Robot, speeds: np.ndarray) -> list[Effect]:
    """Return effects with the servos' speed limits [rad/s; m/s], shape (n,); 0 means none."""
    limits = zip(robot.joints, speeds.tolist(), strict=True)
    return [make_effect("speed_limit", joint, {"speed": speed}) for joint, speed in limits if speed]


def _check_length(rows: np.ndarray, first: np.ndarray) -> np.ndarray:
    if len(rows) != len(first):
        raise OptionError(
            f"Episodes of {len(first)} and {count_of(len(rows), 'step')} are in one file; make them equally long."
        )
    return rows
