"""Readings of one joint as transitions, their velocities computed as recorders compute them."""

from dataclasses import replace

import numpy as np

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import (
    ACTION,
    NEXT_STATE,
    STATE,
    make_effort_feature,
    make_position_feature,
    make_state_feature,
)
from nas_data.dataset.transitions import estimate_velocities


def seen(
    positions: np.ndarray, velocities: np.ndarray, rate: float, formula: str = "quadratic", effort: bool = False
) -> Dataset:
    """Return readings (E, T) of one joint as a dataset; velocities computed by a formula, or those given where ''."""
    steps = np.diff(positions, axis=1) * rate
    computed = {
        "": velocities,
        "backward": np.pad(steps, ((0, 0), (1, 0)), mode="edge"),
        "forward": np.pad(steps, ((0, 0), (0, 1)), mode="edge"),
        "central": np.gradient(positions, 1 / rate, axis=1),
        "quadratic": estimate_velocities(positions.T, rate).T,
    }[formula]
    states = np.stack([positions, computed], axis=-1).astype(np.float32)
    joints = ("joint",)
    command = (make_effort_feature if effort else make_position_feature)(joints)
    features = {STATE: make_state_feature(joints), ACTION: command, NEXT_STATE: make_state_feature(joints)}
    columns = {
        STATE: states[:, :-1].reshape(-1, 2),
        ACTION: states[:, 1:, :1].reshape(-1, 1),
        NEXT_STATE: states[:, 1:].reshape(-1, 2),
    }
    return Dataset(features, columns, np.full(len(positions), positions.shape[1] - 1), rate)


def derived_torques(positions: np.ndarray, torques: np.ndarray, rate: float) -> Dataset:
    """Return positions [rad] and torques [N·m] of one joint 'spindle', shape (E, T), as transitions; speeds derived."""
    dataset = seen(positions, np.zeros_like(positions), rate, effort=True)
    joints = ("spindle",)
    features = {
        STATE: make_state_feature(joints),
        ACTION: make_effort_feature(joints),
        NEXT_STATE: make_state_feature(joints),
    }
    told = torques[:, :-1].reshape(-1, 1).astype(np.float32)
    return replace(dataset, features=features, columns={**dataset.columns, ACTION: told})
