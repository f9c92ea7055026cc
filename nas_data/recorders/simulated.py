"""Recording of episodes from a simulated target, through its sensor model."""

import math
from collections.abc import Callable, Sequence

import numpy as np

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import (
    ACTION,
    ENVIRONMENT,
    NEXT_ENVIRONMENT,
    NEXT_STATE,
    POSITION,
    STATE,
    TIME,
    make_action_feature,
    make_state_feature,
    make_time_feature,
)
from nas_data.recorders.session import RecordingSession
from nas_data.simulators.base import Simulator

BATCH = 5000  # control steps simulated between two progress reports


def record(session: RecordingSession, progress: Callable[[int], None] = lambda done: None) -> list[np.ndarray]:
    """Play a session's commands on its target and read the sensors.

    Each episode starts after the target has held its first pose for half a second. A target with torque or velocity
    commands starts at rest in the pose. An environment's episodes begin in its own start states.

    Args:
        session: Target, commands and starts.
        progress: Called with the number of finished episodes.

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
    """Extend commands of shape (T, n) to `steps` rows by repeating the last one."""
    return np.concatenate([commands, np.repeat(commands[-1:], steps - len(commands), axis=0)])


def play(simulator: Simulator, commands: np.ndarray, initial: np.ndarray, settle: float) -> np.ndarray:
    """Play commands from initial states.

    Args:
        simulator: Target.
        commands: Position [rad], velocity [rad/s] or torque [N·m] commands, shape (B, T, n).
        initial: Initial states, shape (B, 2n), or with objects (B, 2n + m).
        settle: Time for which the first pose is held before [s]; unused unless all joints take positions.

    Returns:
        True states before and after each command, shape (B, T + 1, 2n or 2n + m).
    """
    if set(simulator.kinds) != {POSITION} or not settle:
        return np.concatenate([initial[:, None], simulator.rollout(initial, commands)], axis=1)
    steps = max(1, math.ceil(settle / simulator.period - 1e-9))
    held = np.repeat(initial[:, None, : commands.shape[2]], steps, axis=1)
    return simulator.rollout(initial, np.concatenate([held, commands], axis=1))[:, steps - 1 :]


def to_dataset(session: RecordingSession, measured: Sequence[np.ndarray]) -> Dataset:
    """Return recorded episodes as a dataset.

    Args:
        session: The session that was played.
        measured: Readings of each episode, shape (T + 1, 2n), or with objects (T + 1, 2n + m).
    """
    simulator = session.target.simulator
    joints, commands = simulator.joints, session.commands
    now = np.concatenate([episode[:-1] for episode in measured]).astype(np.float32)
    after = np.concatenate([episode[1:] for episode in measured]).astype(np.float32)
    n = len(joints)
    features = {
        STATE: make_state_feature(joints, simulator.slides),
        ACTION: make_action_feature(joints, simulator.kinds, simulator.slides),
        NEXT_STATE: make_state_feature(joints, simulator.slides),
        TIME: make_time_feature(),
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
