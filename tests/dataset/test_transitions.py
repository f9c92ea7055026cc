"""Deriving velocities and next states from what other people's recordings hold."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.changed_columns import set_values
from support.dataset_samples import recorded

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.external import audit_external
from nas_data.dataset.features import (
    ACTION,
    NEXT_STATE,
    SIM_STATE,
    STATE,
    Feature,
    make_position_feature,
    make_state_feature,
)
from nas_data.dataset.layout import PROVENANCE
from nas_data.dataset.provenance import Provenance
from nas_data.dataset.transitions import as_transitions, estimate_velocities
from nas_data.dataset.write import write
from nas_data.errors import DatasetInvalid, JointMismatch
from nas_data.importing.lerobot import ImportOptions, import_dataset

JOINTS = ("a", "b")
REAL = Path(__file__).parents[3] / "shared/realdata/sage_so101"


def positions_only(lengths=(9, 6), names=("a.pos", "b.pos"), action=None, units=(), seed=0) -> Dataset:
    """Return a recording with LeRobot's keys only."""
    rng = np.random.default_rng(seed)
    features = {STATE: Feature(names, units), ACTION: Feature(action or names, units)}
    columns = {
        key: np.cumsum(rng.normal(scale=0.02, size=(sum(lengths), feature.width)), axis=0).astype(np.float32)
        for key, feature in features.items()
    }
    return Dataset(features, columns, np.array(lengths), 50.0, "arm", ("x",) * len(lengths))


def test_a_complete_dataset_is_left_alone():
    dataset = recorded()
    same, derived = as_transitions(dataset)
    assert derived == {}
    assert all(same.columns[key] is dataset.columns[key] for key in dataset.columns)


def test_next_states_are_the_following_frames_of_the_same_episode():
    dataset = positions_only()
    done, derived = as_transitions(dataset)
    assert done.lengths.tolist() == [8, 5]
    for before, after in zip(dataset.episodes(), done.episodes(), strict=True):
        assert np.array_equal(done.states[after, :2], dataset.states[before][:-1])
        assert np.array_equal(done.next_states[after, :2], dataset.states[before][1:])
        assert np.array_equal(done.next_states[after][:-1], done.states[after][1:])
        assert np.array_equal(done.commands[after], dataset.commands[before][:-1])
    assert {STATE, NEXT_STATE} <= derived.keys()
    assert done.features[STATE] == make_state_feature(JOINTS) == done.features[NEXT_STATE]


@given(st.lists(st.floats(-3, 3), min_size=3, max_size=3), st.integers(3, 12), st.sampled_from([20.0, 100.0]))
def test_the_velocity_of_any_quadratic_motion_is_recovered_to_its_ends(coefficients, samples, fps):
    time = np.arange(samples)[:, None] / fps
    motion = np.polynomial.polynomial.polyval(time, coefficients)
    truth = coefficients[1] + 2 * coefficients[2] * time
    assert np.allclose(estimate_velocities(motion, fps), truth, atol=1e-9 * fps)


def test_short_episodes_have_velocities_too():
    assert estimate_velocities(np.array([[1.0], [1.5]]), 10.0).tolist() == [[5.0], [5.0]]
    assert estimate_velocities(np.array([[1.0]]), 10.0).tolist() == [[0.0]]


def test_velocities_do_not_reach_across_episodes():
    whole = positions_only()
    dataset = set_values(whole, STATE, slice(9, None), whole.states[9:] + 5.0)
    jumped, _ = as_transitions(dataset)
    plain, _ = as_transitions(positions_only())
    assert np.allclose(jumped.states[:, 2:], plain.states[:, 2:], atol=1e-3)


def test_episodes_of_one_frame_are_dropped_with_their_task():
    dataset = replace(positions_only(lengths=(4, 1, 3)), tasks=("x", "y", "z"))
    done, _ = as_transitions(dataset)
    assert (done.lengths.tolist(), done.tasks) == ([3, 2], ("x", "z"))
    with pytest.raises(DatasetInvalid, match="single frame"):
        as_transitions(positions_only(lengths=(1, 1)))


def test_an_episode_of_one_frame_is_named_where_a_dataset_is_read(tmp_path):
    dataset = replace(positions_only(lengths=(9, 1, 6)), tasks=("x", "y", "z"))
    write(dataset, tmp_path / "d", Provenance(how="simulated"))
    (tmp_path / "d" / PROVENANCE).unlink()
    done, _, warnings = audit_external(tmp_path / "d", dataset)
    assert done.lengths.tolist() == [8, 5]
    assert any("in episode 1 there is a single frame, which makes no transition" in said for said in warnings)
    assert any("episode 1" in finding.file for finding in import_dataset(tmp_path / "d", ImportOptions())[2])


def test_recorded_velocities_are_kept():
    full = recorded(lengths=(6, 4))
    keys = (STATE, ACTION)
    dataset = replace(full, features={k: full.features[k] for k in keys}, columns={k: full.columns[k] for k in keys})
    done, derived = as_transitions(dataset)
    assert set(derived) == {NEXT_STATE}
    assert np.array_equal(done.states, np.concatenate([full.states[:5], full.states[6:9]]))


def test_recorded_next_positions_are_kept_and_no_frame_is_dropped():
    full = recorded(lengths=(6, 4))
    feature = make_position_feature(full.joints)
    dataset = full.with_column(STATE, feature, full.states[:, :3])
    dataset = dataset.with_column(NEXT_STATE, feature, full.next_states[:, :3])
    done, derived = as_transitions(dataset)
    assert set(derived) == {STATE, NEXT_STATE}
    assert done.n_frames == full.n_frames
    assert np.array_equal(done.next_states[:, :3], full.next_states[:, :3])
    assert np.array_equal(done.next_states[:5], done.states[1:6])
    torn = dataset.with_column(NEXT_STATE, feature, dataset.next_states[::-1])
    with pytest.raises(DatasetInvalid, match="not the following frame"):
        as_transitions(torn)


def test_bare_joint_names_mean_positions():
    done, _ = as_transitions(positions_only(names=JOINTS))
    assert done.joints == JOINTS
    assert done.features[ACTION].names == ("a.pos", "b.pos")


def test_components_are_put_in_the_order_of_the_joints():
    dataset = positions_only(names=("a.pos", "a.vel", "b.pos", "b.vel", "load"), action=("b", "a"))
    done, derived = as_transitions(dataset)
    assert done.features[STATE].names == ("a.pos", "b.pos", "a.vel", "b.vel")
    assert np.array_equal(done.states[:8], dataset.states[:8][:, [0, 2, 1, 3]])
    assert np.array_equal(done.commands[:8], dataset.commands[:8][:, [1, 0]])
    assert "load" in derived[STATE]


def test_torques_stay_torques():
    done, _ = as_transitions(positions_only(action=("a.effort", "b.effort")))
    assert set(done.kinds) == {".effort"}


def test_objects_get_their_next_state_too():
    dataset = positions_only()
    key = "observation.environment_state"
    puck = Feature(("puck.x", "puck.y"), ("m", "m"))
    dataset = dataset.with_column(key, puck, np.arange(30, dtype=np.float32).reshape(15, 2))
    done, _ = as_transitions(dataset)
    assert np.array_equal(done.columns[f"next.{key}"], done.columns[key] + 2)


@pytest.mark.parametrize(
    ("names", "action"),
    [
        (("a.pos", "b.pos"), ("a.pos", "c.pos")),
        (("a.pos", "b.pos"), ("a.pos",)),
        (("a.pos", "b.pos", "a.vel"), ("a.pos", "b.pos")),
        (("observation.state.0", "observation.state.1"), ("a.pos", "b.pos")),
        (("a.effort", "b.effort"), ("a.pos", "b.pos")),
    ],
)
def test_joints_that_do_not_agree_are_refused(names, action):
    with pytest.raises(JointMismatch, match="joint"):
        as_transitions(positions_only(names=names, action=action))


def test_a_recording_without_commands_is_refused():
    dataset = positions_only()
    with pytest.raises(JointMismatch, match="no feature 'action'"):
        as_transitions(replace(dataset, features={STATE: dataset.features[STATE]}))


@pytest.mark.parametrize("key", [STATE, ACTION])
def test_degrees_are_refused_by_their_size(key):
    dataset = set_values(positions_only(), key, (3, 1), -90.0)
    with pytest.raises(DatasetInvalid, match=rf"'{key}' of joint b reaches 90.*nas import --map"):
        as_transitions(dataset)


@pytest.mark.parametrize("unit", ["deg", "degree", "%", "ticks"])
def test_positions_in_another_unit_are_refused(unit):
    with pytest.raises(DatasetInvalid, match=f"joint a is in {unit}, rad is needed"):
        as_transitions(positions_only(units=(unit, unit)))


def test_missing_units_are_said_to_be_assumed():
    _, derived = as_transitions(positions_only())
    assert "no unit" in derived[STATE] and "no unit" in derived[ACTION]
    _, derived = as_transitions(positions_only(units=("rad", "rad")))
    assert ACTION not in derived and "no unit" not in derived[STATE]


def test_predictions_without_a_next_state_are_refused():
    dataset = positions_only()
    paired = dataset.with_column(SIM_STATE, dataset.features[STATE], dataset.states)
    with pytest.raises(DatasetInvalid, match="pair afterwards"):
        as_transitions(paired)


@pytest.mark.skipif(not REAL.is_dir(), reason="the real recordings are not beside the repository")
def test_velocities_of_a_real_arm_agree_with_what_its_servos_report():
    log = np.load(next(REAL.rglob("chirp_sweep.npz")))
    time, moving = log["t"], log["velocity"].std(axis=0) > 0.1
    moving[5] = False  # the gripper is in shares of its range
    estimate = estimate_velocities(log["position"], 1 / np.diff(time).mean())
    for joint in np.flatnonzero(moving):
        assert np.corrcoef(estimate[:, joint], log["velocity"][:, joint])[0, 1] > 0.9
    assert moving.any()
