"""Recordings of simulated targets whose gap to their source is known, in the form that recorders give them."""

from collections.abc import Sequence

import numpy as np

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import (
    ACTION,
    NEXT_STATE,
    POSITION,
    SIM_STATE,
    STATE,
    make_action_feature,
    make_state_feature,
)
from nas_data.effects.servo_stiffness import ServoStiffness
from nas_data.effects.viscous_friction import ViscousFriction
from nas_data.pairing import pair
from nas_data.simulators.base import Simulator
from nas_data.simulators.mujoco import MujocoSimulator

RATE = 50.0  # [Hz]
# a third of the stiffness and as much friction again: the source sags and lags by degrees
GAP = (
    ServoStiffness(joint="pendulum", factor=0.6),
    ViscousFriction(joint="pendulum", coefficient=0.03),
)


def pendulum(*effects, rate: float = RATE) -> MujocoSimulator:
    """Return the pendulum on one thread."""
    return MujocoSimulator.load("pendulum", 1 / rate, effects=effects, threads=1)


def wander(lengths: Sequence[int], joints: int = 1, seed: int = 0, size: float = 1.2) -> list[np.ndarray]:
    """Return smooth random commands of each episode, shape (T, n): targets held half a second, approached in ramps."""
    rng = np.random.default_rng(seed)
    episodes = []
    for length in lengths:
        knots = rng.uniform(-size, size, (length // 25 + 2, joints))
        times = np.linspace(0, len(knots) - 1, length)
        episodes.append(np.stack([np.interp(times, np.arange(len(knots)), knot) for knot in knots.T], axis=1))
    return episodes


def recorded_on(target: Simulator, commands: Sequence[np.ndarray], seed: int = 0) -> Dataset:
    """Play commands on a target, each episode started at rest where its first command is; return the dataset."""
    rng = np.random.default_rng(seed)
    n = len(target.joints)
    chains = []
    for episode in commands:
        start = np.concatenate([episode[0] if set(target.kinds) == {POSITION} else rng.uniform(-1, 1, n), np.zeros(n)])
        chains.append(np.concatenate([start[None], target.rollout(start[None], episode[None])[0]]))
    action = make_action_feature(target.joints, target.kinds)
    return Dataset(
        features={
            STATE: make_state_feature(target.joints),
            ACTION: action,
            NEXT_STATE: make_state_feature(target.joints),
        },
        columns={
            STATE: np.concatenate([chain[:-1] for chain in chains]).astype(np.float32),
            ACTION: np.concatenate(commands).astype(np.float32),
            NEXT_STATE: np.concatenate([chain[1:] for chain in chains]).astype(np.float32),
        },
        lengths=np.array([len(episode) for episode in commands]),
        fps=round(1 / target.period, 6),
        robot_type=str(target.describe()["name"]),
    )


def paired_pendulum(lengths: Sequence[int] = (100,) * 6, seed: int = 0, effects=GAP) -> Dataset:
    """Return recordings of a pendulum with a gap, paired with the pendulum without."""
    return pair(recorded_on(pendulum(*effects), wander(lengths, seed=seed)), pendulum())


def positions_only(dataset: Dataset) -> Dataset:
    """Return what LeRobot's own recorder would have kept: positions and commands, nothing of ours."""
    n = len(dataset.joints)
    names = tuple(f"{joint}.pos" for joint in dataset.joints)
    return Dataset(
        features={key: type(dataset.features[key])(names) for key in (STATE, ACTION)},
        columns={STATE: dataset.states[:, :n], ACTION: dataset.commands},
        lengths=dataset.lengths,
        fps=dataset.fps,
        robot_type=dataset.robot_type,
    )


def without(dataset: Dataset, key: str = SIM_STATE) -> Dataset:
    """Return the dataset without a column."""
    features = {name: feature for name, feature in dataset.features.items() if name != key}
    columns = {name: dataset.columns[name] for name in features}
    return Dataset(features, columns, dataset.lengths, dataset.fps, dataset.robot_type, dataset.tasks)
