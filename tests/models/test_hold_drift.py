"""Drift while the command is constant, on motions whose drift is known."""

import json
import math

import numpy as np
import pytest

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import ACTION, NEXT_STATE, STATE, make_position_feature, make_state_feature
from nas_data.models.evaluation import evaluate, measure_hold_drift
from nas_data.models.hold_drift import HoldDrift, find_holds

RATE = 10.0
HOLD = 50  # frames
JOINTS = ("held", "told")


def recording(lengths: tuple[int, ...] = (80, 70)) -> Dataset:
    """Episodes in which one joint is told to stay and does, and the other is told to move all the time."""
    total = sum(lengths)
    commands = np.stack([np.ones(total), np.arange(total)], axis=1).astype(np.float32)
    states = np.concatenate([commands, np.zeros((total, 2))], axis=1).astype(np.float32)
    features = {
        STATE: make_state_feature(JOINTS),
        ACTION: make_position_feature(JOINTS),
        NEXT_STATE: make_state_feature(JOINTS),
    }
    return Dataset(features, {STATE: states, ACTION: commands, NEXT_STATE: states}, np.array(lengths), RATE)


def drifting(dataset: Dataset, speed: float) -> list[np.ndarray]:
    """Return the measured states, from which the prediction drifts at some speed [rad/s], beginning 1 rad off."""
    return [
        dataset.next_states[rows] + 1 + speed * np.arange(rows.stop - rows.start)[:, None] / RATE
        for rows in dataset.episodes()
    ]


def test_the_drift_is_the_change_of_the_error_in_five_seconds():
    dataset = recording()
    found = HoldDrift.of(dataset, {"still": drifting(dataset, 0.0), "slow": drifting(dataset, -0.01)})
    assert found.holds.tolist() == [30 + 20, 0]
    assert found.drift["still"][0] == pytest.approx(0.0, abs=1e-6)
    assert found.drift["slow"][0] == pytest.approx(0.05)
    assert found.average("slow") == pytest.approx(0.05)
    assert np.isnan(found.drift["slow"][1])
    assert f"{math.degrees(0.05):.3f}" in found.text()


def test_a_prediction_that_moves_with_the_arm_does_not_drift():
    dataset = recording()
    dataset.columns[NEXT_STATE] = np.concatenate(drifting(dataset, 0.3)).astype(np.float32)
    rolled = [dataset.next_states[rows] for rows in dataset.episodes()]
    assert HoldDrift.of(dataset, {"φ": rolled}).drift["φ"][0] == pytest.approx(0.0, abs=1e-6)


def test_a_command_that_changes_once_ends_the_hold():
    commands = np.zeros((200, 1))
    commands[100:] = 1
    mask = find_holds(commands, HOLD)[:, 0]
    assert mask.tolist() == [start + HOLD < 100 or start >= 100 for start in range(150)]


def test_short_episodes_hold_nothing():
    dataset = recording((40,))
    assert not find_holds(dataset.commands, HOLD).any()
    assert measure_hold_drift(dataset, {"φ": drifting(dataset, 0.1)}) is None


def test_the_json_has_no_number_where_there_is_none():
    dataset = recording()
    found = HoldDrift.of(dataset, {"φ": drifting(dataset, math.nan)}).to_json()
    json.dumps(found, allow_nan=False)
    assert found == {"φ": {"held": None, "told": None, "all": None}}


def test_an_evaluation_without_a_model_says_nothing_of_drift():
    assert evaluate(recording(), None, None).holding is None
