"""Errors by regime of motion: each joint's frames are counted in the regime of its speed, in the joint's own unit."""

import json
import math

import numpy as np
import pytest

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import ACTION, NEXT_STATE, STATE, make_position_feature, make_state_feature
from nas_data.models.regimes import REGIMES, RegimeErrors, measure_speeds

RATE, FRAMES = 50.0, 400
JOINTS = ("still", "mover")
SPEEDS = (0.0, math.radians(10.0), math.radians(60.0))  # of the second joint, one regime after another


def motion() -> np.ndarray:
    """Positions (1200, 2): one joint never moves; the other holds, moves slowly, then fast."""
    steps = np.repeat(SPEEDS, FRAMES) / RATE
    return np.stack([np.full(len(steps), 0.5), np.cumsum(steps)], axis=1)


def recording(slides: tuple[str, ...] = (), size: float = 1.0) -> Dataset:
    """Return the motion, of another size, as one episode."""
    states = np.concatenate([size * motion(), np.zeros((len(motion()), 2))], axis=1).astype(np.float32)
    features = {
        STATE: make_state_feature(JOINTS, slides),
        ACTION: make_position_feature(JOINTS, slides),
        NEXT_STATE: make_state_feature(JOINTS, slides),
    }
    return Dataset(features, {STATE: states, ACTION: states[:, :2], NEXT_STATE: states}, np.array([len(states)]), RATE)


def shifted(dataset: Dataset, by_regime: tuple[float, float, float]) -> list[np.ndarray]:
    """Return the measured states, with the second joint shifted by one distance [rad] in each regime."""
    states = dataset.next_states.astype(float)
    states[:, 1] += np.repeat(by_regime, FRAMES)
    return [states]


def compare(source: tuple[float, float, float], corrected: tuple[float, float, float]) -> RegimeErrors:
    """Return the errors of two rollouts whose second joint is shifted."""
    dataset = recording()
    return RegimeErrors.of(dataset, shifted(dataset, source), shifted(dataset, corrected))


def test_each_frame_is_in_the_regime_of_its_joints_speed():
    found = compare((0.1, 0.1, 0.1), (0.1, 0.1, 0.1))
    assert found.frames[:, 0].tolist() == [3 * FRAMES, 0, 0]
    np.testing.assert_allclose(found.frames[:, 1], FRAMES, atol=15)
    assert found.frames.sum(axis=0).tolist() == [3 * FRAMES] * 2


def test_errors_are_those_of_each_regime():
    found = compare((0.1, 0.2, 0.3), (0.2, 0.2, 0.0))
    # within a quarter of a second of a change of speed, frames are in the neighbouring regime
    np.testing.assert_allclose(np.sqrt(found.source[:, 1]), (0.1, 0.2, 0.3), rtol=0.05)
    np.testing.assert_allclose(np.sqrt(found.corrected[:2, 1]), (0.2, 0.2), rtol=0.05)
    assert found.source[0, 0] == found.corrected[0, 0] == pytest.approx(0.0, abs=1e-9)
    assert np.isnan(found.source[1:, 0]).all()


def test_a_phi_that_drifts_while_holding_is_said_to_harm_there():
    found = compare((0.1, 0.2, 0.3), (0.2, 0.1, 0.1))
    assert found.helps == {"holding": False, "slow": True, "fast": True}
    assert found.find_harmed_joints()["holding"] == ["mover"], "the joint that never moves has no error"
    assert "fast" not in found.find_harmed_joints()
    text = found.text()
    assert "φ reduces the error in: slow, fast. It does not in: holding." in text
    assert "Joints whose error φ does not reduce: holding: mover." in text
    assert "–" in text, "the joint that never moves has no error in motion"


def test_a_phi_that_helps_everywhere_is_not_blamed():
    found = compare((0.3, 0.3, 0.3), (0.1, 0.1, 0.1))
    assert set(found.helps.values()) == {True}
    assert "It does not" not in found.text()


def test_a_phi_that_diverges_helps_nowhere_it_diverged():
    found = compare((0.1, 0.1, 0.1), (0.05, 0.05, math.nan))
    assert not found.helps["fast"]
    assert found.helps["holding"]
    assert "diverged" in found.text()
    assert found.to_json()["fast"]["corrected"]["mover"] is None


def test_the_json_holds_both_errors_by_regime_and_joint():
    found = compare((0.1, 0.2, 0.3), (0.2, 0.1, 0.1)).to_json()
    json.dumps(found, allow_nan=False)
    assert list(found) == list(REGIMES)
    assert found["slow"]["source"]["mover"] == pytest.approx(0.2, rel=0.05)
    assert found["slow"]["source"]["still"] is None
    assert found["slow"]["frames"]["still"] == 0


def test_speeds_of_slides_are_relative_to_their_range():
    large, small = (recording(slides=("mover",), size=size) for size in (1.0, 0.1))
    found = [RegimeErrors.of(data, shifted(data, (0, 0, 0)), shifted(data, (0, 0, 0))) for data in (large, small)]
    np.testing.assert_allclose(found[0].frames, found[1].frames, atol=2)
    assert found[0].frames[1, 1] > 0
    assert "mover mm" in found[0].text()


def test_a_single_frame_is_at_rest():
    assert measure_speeds(np.ones((1, 2)), RATE).tolist() == [[0.0, 0.0]]
