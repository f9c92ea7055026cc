"""Audits: a sound recording passes all of them, and each fires on what it is for, with the rows."""

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.import_samples import RATE, Motion, columns_of, map_text, motion, write_log, write_map

from nas_data import registry
from nas_data.dataset.audits import find_audit
from nas_data.dataset.audits.base import AuditFinding
from nas_data.importing.auditing import audit
from nas_data.importing.map_file import ALLOWABLE, load_map
from nas_data.importing.reading import read_log
from nas_data.recorders.logs import import_logs

LIMITS = "[limits]\nshoulder = [-1.5, 1.5]\nelbow = [-1.5, 1.5]\n"
RELEASED = '[signals.torque_enable]\ncolumn = "on"\nunit = "1"'


def findings(folder: Path, recording: Motion, extra: str = "", **changes: str) -> list[AuditFinding]:
    log = write_log(folder / "log.npz", columns_of(recording))
    mapping = load_map(write_map(folder, map_text(extra=extra, **changes)))
    return audit(read_log(log, mapping)[0], mapping)


def only(found: list[AuditFinding], check: str) -> list[AuditFinding]:
    """The findings of one check; no other check may have fired."""
    assert {finding.check for finding in found} == {check}, found
    return found


def with_row(values: np.ndarray, row: int, value: float) -> np.ndarray:
    """A copy with one number replaced, in the second joint where there are joints."""
    changed = values.copy()
    changed[(row, 1) if values.ndim == 2 else row] = value
    return changed


@settings(max_examples=30, deadline=None)
@given(phase=st.floats(0, 6), amplitude=st.floats(0.1, 1.2), rows=st.integers(20, 300))
def test_a_sound_recording_passes_every_audit(tmp_path_factory, phase, amplitude, rows):
    folder = tmp_path_factory.mktemp("sound")
    recording = motion(rows, phase=phase, amplitude=amplitude)
    assert findings(folder, recording, LIMITS) == []


def test_jitter_within_the_tolerance_passes(tmp_path):
    rng = np.random.default_rng(0)
    recording = motion()
    assert findings(tmp_path, recording.edited(time=recording.time + rng.uniform(0, 0.0015, 120))) == []


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("what", ["time", "position", "velocity", "command"])
def test_values_that_are_not_finite_are_refused_by_row(tmp_path, what, value):
    recording = motion()
    broken = recording.edited(**{what: with_row(getattr(recording, what), 17, value)})
    (finding,) = only(findings(tmp_path, broken), "not_finite")
    assert finding.error and finding.rows == (17,)
    assert what in finding.message


def test_a_signal_that_is_not_finite_is_refused(tmp_path):
    on = with_row(np.ones((120, 2)), 3, np.nan)
    (finding,) = only(findings(tmp_path, motion().edited(signals={"on": on}), RELEASED), "not_finite")
    assert finding.error and finding.rows == (3,) and "torque_enable" in finding.message


def test_time_that_goes_back_is_refused_by_row(tmp_path):
    recording = motion()
    time = recording.time.copy()
    time[60:] -= 0.5
    (finding,) = only(findings(tmp_path, recording.edited(time=time)), "time_backwards")
    assert finding.error and finding.rows == (60,)


def test_unsigned_times_that_go_back_do_not_wrap_round(tmp_path):
    recording = motion()
    ticks = with_row(np.round(recording.time * 1e6), 30, 0).astype(np.uint64)
    found = findings(tmp_path, recording.edited(time=ticks), time='column = "t"\nunit = "us"')
    assert only(found, "time_backwards")[0].rows == (30,)


def test_time_that_stands_still_is_reported_by_row(tmp_path):
    recording = motion()
    found = findings(tmp_path, recording.edited(time=with_row(recording.time, 30, recording.time[29])))
    assert [finding.rows for finding in found if finding.check == "repeated_time"] == [(30,)]
    assert [finding.rows for finding in found if finding.check == "irregular_time"] == [(31,)]
    (stopped,) = only(findings(tmp_path, recording.edited(time=np.zeros(120))), "repeated_time")
    assert stopped.error and len(stopped.rows) == 119


@pytest.mark.parametrize(("repeats", "error"), [(2, False), (3, True)])
def test_a_clock_that_stands_still_in_most_rows_is_refused(tmp_path, repeats, error):
    recording = motion(rows=121)
    rough = recording.edited(time=recording.time[np.arange(121) // repeats * repeats])
    found = [finding for finding in findings(tmp_path, rough) if finding.check == "repeated_time"]
    assert [finding.error for finding in found] == [error] and len(found[0].rows) == 121 - -(-121 // repeats)
    even = '[resample]\nrate = 10.0\nmethod = "previous"'
    assert not any(finding.error for finding in findings(tmp_path, rough, even) if finding.check == "repeated_time")


def test_uneven_steps_are_reported_by_row_with_the_remedy(tmp_path):
    recording = motion()
    time = recording.time.copy()
    time[40:] += 0.02
    (finding,) = only(findings(tmp_path, recording.edited(time=time)), "irregular_time")
    assert not finding.error and finding.rows == (40,)
    assert "add [resample]" in finding.message


def test_resampling_reports_gaps_only(tmp_path):
    resample = '[resample]\nrate = 50.0\nmethod = "linear"'
    recording = motion()
    time = recording.time.copy()
    time[40:] += 0.015
    assert findings(tmp_path, recording.edited(time=time), resample) == []
    time[40:] += 0.05
    (finding,) = only(findings(tmp_path, recording.edited(time=time), resample), "time_gap")
    assert finding.rows == (40,)


@pytest.mark.parametrize(("factor", "error"), [(1.01, False), (0.5, True), (1000.0, True), (0.001, True)])
def test_another_rate_than_the_maps_is_reported_and_a_gross_one_refused(tmp_path, factor, error):
    recording = motion()
    found = findings(tmp_path, recording.edited(time=recording.time * factor), velocity='"derive"')
    (finding,) = [finding for finding in found if finding.check == "rate"]
    assert finding.error is error
    assert f"rows come at {RATE / factor:.6g} Hz, but the map says 50 Hz" in finding.message


def test_milliseconds_read_as_seconds_are_refused_even_when_resampled(tmp_path):
    recording = motion()
    resample = '[resample]\nrate = 100.0\nmethod = "linear"'
    found = findings(tmp_path, recording.edited(time=recording.time * 1000), resample)
    assert any(finding.check == "rate" and finding.error for finding in found)


def test_jumps_are_reported_by_joint_and_row(tmp_path):
    recording = motion()
    found = findings(tmp_path, recording.edited(position=with_row(recording.position, 50, 2.0)))
    jumps = [finding for finding in found if finding.check == "jump"]
    assert [finding.rows for finding in jumps] == [(50, 51)]
    assert "elbow" in jumps[0].message and not jumps[0].error
    (slow,) = only(findings(tmp_path, recording, "[audit]\nmax_speed = 3.5"), "jump")
    assert "more than 3.5 rad/s" in slow.message


def test_an_encoders_wrap_is_named(tmp_path):
    recording = motion(amplitude=1.0)
    wrapped = np.where(recording.position > 0.9, recording.position - 2 * np.pi, recording.position)
    found = findings(tmp_path, recording.edited(position=wrapped))
    assert any(finding.check == "jump" and "wrap" in finding.message for finding in found)


def test_a_velocity_that_no_joint_has_is_a_jump(tmp_path):
    recording = motion()
    (finding,) = only(findings(tmp_path, recording.edited(velocity=with_row(recording.velocity, 9, 80.0))), "jump")
    assert finding.rows == (9,)


@pytest.mark.parametrize("what", ["command", "position"])
def test_values_beyond_the_limits_are_reported_by_joint_and_row(tmp_path, what):
    recording = motion()
    edge = float(np.sort(getattr(recording, what)[:, 0])[-3])  # the two highest rows are beyond
    limits = f"[limits]\nshoulder = [-1.5, {edge + 1e-5}]"
    recording = recording.edited(**{"command" if what == "position" else "position": 0.9 * recording.position})
    (finding,) = only(findings(tmp_path, recording, limits), f"{what}_beyond_limits")
    assert finding.rows == tuple(np.flatnonzero(getattr(recording, what)[:, 0] > edge + 1e-5).tolist())
    assert len(finding.rows) == 2 and "shoulder" in finding.message and not finding.error


def refused(found: list[AuditFinding], check: str) -> list[AuditFinding]:
    """The errors; all must be of one check."""
    errors = [finding for finding in found if finding.error]
    assert {finding.check for finding in errors} == {check}, found
    return errors


def test_degrees_read_as_radians_are_refused_with_the_remedy(tmp_path):
    recording = motion()
    degrees = recording.edited(
        position=np.degrees(recording.position),
        velocity=np.degrees(recording.velocity),
        command=np.degrees(recording.command),
    )
    errors = refused(findings(tmp_path, degrees), "unit_slip")
    assert len(errors) == 4 and all(error.rows for error in errors)
    assert "unit in [read.position]" in errors[0].message


def test_small_degrees_are_refused_where_limits_rule_them_out(tmp_path):
    recording = motion(amplitude=0.08)  # 4.6 degrees: as radians within two turns
    degrees = recording.edited(
        position=np.degrees(recording.position),
        velocity=np.degrees(recording.velocity),
        command=np.degrees(recording.command),
    )
    assert refused(findings(tmp_path, degrees, LIMITS), "unit_slip")[0].rows


def test_radians_read_as_degrees_are_refused_unless_the_map_insists(tmp_path):
    degrees = {
        "position": 'column = "q"\nunit = "deg"',
        "register": 'column = "dq"\nunit = "deg/s"',
        "command": 'column = "goal"\nunit = "deg"',
    }
    errors = refused(findings(tmp_path, motion(), **degrees), "unit_slip")
    assert "use unit = 'rad' in [read.position]" in errors[0].message
    allowed = findings(tmp_path, motion(), '[audit]\nallow = ["unit_slip"]', **degrees)
    assert [finding.error for finding in only(allowed, "unit_slip")] == [False, False]


def test_a_robot_at_rest_is_not_taken_for_radians(tmp_path):
    still = motion(amplitude=0.0)
    degrees = {"position": 'column = "q"\nunit = "deg"', "command": 'column = "goal"\nunit = "deg"'}
    assert findings(tmp_path, still, **degrees) == []


def test_a_command_in_another_unit_than_the_position_is_refused(tmp_path):
    recording = motion(amplitude=0.1)
    errors = refused(findings(tmp_path, recording.edited(command=np.degrees(recording.command))), "command_scale")
    assert len(errors) == 2 and "57" in errors[0].message
    errors = refused(findings(tmp_path, recording.edited(command=np.radians(recording.command))), "command_scale")
    assert len(errors) == 2


def test_a_position_that_moves_against_its_command_is_reported(tmp_path):
    recording = motion()
    found = only(findings(tmp_path, recording.edited(command=-recording.command)), "command_sign")
    assert [finding.error for finding in found] == [False, False]


@pytest.mark.parametrize("factor", [180 / np.pi, np.pi / 180, 30 / np.pi, np.pi / 30, 6.0, 1 / 6, 0.001])
def test_a_velocity_register_in_another_unit_is_refused(tmp_path, factor):
    recording = motion()
    fast = "[audit]\nmax_speed = 1e6"
    errors = refused(findings(tmp_path, recording.edited(velocity=recording.velocity * factor), fast), "velocity_scale")
    assert len(errors) == 2 and "the factor between" in errors[0].message


def test_a_velocity_register_of_opposite_sign_is_refused(tmp_path):
    recording = motion()
    (error,) = refused(findings(tmp_path, recording.edited(velocity=-recording.velocity)), "velocity_scale")
    assert "sign" in error.message


def test_a_velocity_register_without_content_is_refused_where_the_joint_moves(tmp_path):
    recording = motion()
    silent = recording.edited(velocity=recording.velocity * np.array([1.0, 0.0]))
    (error,) = refused(findings(tmp_path, silent), "velocity_scale")
    assert "elbow is zero in all rows" in error.message and "velocity = 'derive'" in error.message
    slow = motion(amplitude=0.02)
    assert findings(tmp_path, slow.edited(velocity=np.zeros((120, 2)))) == []


def test_a_velocity_register_off_by_an_odd_factor_is_reported(tmp_path):
    recording = motion()
    found = only(findings(tmp_path, recording.edited(velocity=recording.velocity * 1.3)), "velocity_scale")
    assert all(not finding.error and "1.3" in finding.message for finding in found)


def test_a_late_velocity_register_is_reported_with_its_delay(tmp_path):
    recording = motion(rows=400)
    late = np.vstack([np.repeat(recording.velocity[:1], 2, axis=0), recording.velocity[:-2]])
    (finding,) = only(findings(tmp_path, recording.edited(velocity=late)), "velocity_lag")
    assert "40 ms" in finding.message
    assert findings(tmp_path, recording.edited(velocity=late), velocity='"derive"') == []


@pytest.mark.parametrize("policy", ['"measured"', '"derive"'])
def test_single_repeated_samples_are_reported_by_row(tmp_path, policy):
    """A recorder at 100 Hz that gets 85 Hz of answers."""
    recording = motion(rows=200, amplitude=1.0)
    quantum = 0.005
    position, velocity = np.round(recording.position / quantum) * quantum, recording.velocity.copy()
    repeated = np.arange(13, 200, 7)
    position[repeated], velocity[repeated] = position[repeated - 1], velocity[repeated - 1]
    changes = {"velocity": policy}
    if policy == '"derive"':
        changes["register"] = 'column = "q"\nunit = "rad/s"'  # the text is dropped below
    text = map_text(**changes)
    if policy == '"derive"':
        text = re.sub(r"\[read\.velocity\][^[]*", "", text)
    log = write_log(tmp_path / "log.npz", columns_of(recording.edited(position=position, velocity=velocity)))
    mapping = load_map(write_map(tmp_path, text))
    (part,), _ = read_log(log, mapping)
    (finding,) = only(audit([part], mapping), "repeated_samples")
    assert set(finding.rows) <= set(repeated.tolist())
    assert len(finding.rows) > 0.6 * len(repeated)  # near a turning point nothing moves, stale or not


@pytest.mark.parametrize("extra", ["", '[resample]\nrate = 50.0\nmethod = "linear"'])
@pytest.mark.parametrize("apart", [1, 3])
def test_rows_written_twice_are_not_taken_for_repeated_readings(tmp_path, extra, apart):
    recording = motion(rows=200, amplitude=1.0)
    twice = np.sort(np.concatenate([np.arange(200), np.arange(0, 200, apart)]))
    parts = {key: getattr(recording, key)[twice] for key in ("time", "position", "velocity", "command")}
    assert only(findings(tmp_path, recording.edited(**parts), extra), "repeated_time")
    slower = {key: parts[key][np.searchsorted(twice, twice // 2 * 2)] for key in ("position", "velocity")}
    found = findings(tmp_path, recording.edited(**parts | slower), extra)
    if extra:  # of rows written twice, one counts
        assert "the robot gave about 25 readings per second, not 50" in found[-1].message


def test_a_reading_that_stands_still_under_a_moving_command_is_reported(tmp_path):
    recording = motion()
    position, velocity = recording.position.copy(), recording.velocity.copy()
    position[50:80], velocity[50:80] = position[50], 0.0
    found = only(findings(tmp_path, recording.edited(position=position, velocity=velocity)), "repeated_samples")
    assert found[-1].rows == tuple(range(51, 80))
    assert "sticks, or the readings are stale" in found[-1].message


def test_rest_under_a_resting_command_is_no_finding(tmp_path):
    recording = motion()
    held = {key: np.vstack([getattr(recording, key)[:60], np.repeat(getattr(recording, key)[60:61], 60, axis=0)])
            for key in ("position", "command")}  # fmt: skip
    velocity = np.vstack([recording.velocity[:60], np.zeros((60, 2))])
    assert findings(tmp_path, recording.edited(**held, velocity=velocity)) == []


def test_rows_without_torque_are_reported(tmp_path):
    on = np.ones((120, 2))
    on[70:, 1] = 0
    (finding,) = only(findings(tmp_path, motion().edited(signals={"on": on}), RELEASED), "torque_off")
    assert finding.rows == tuple(range(70, 120))


def test_a_hole_in_the_time_divides_the_log(tmp_path):
    recording = motion()
    time = recording.time.copy()
    time[40:] += 3
    (finding,) = only(findings(tmp_path, recording.edited(time=time)), "time_gap")
    assert not finding.error and finding.rows == (40,)
    assert finding.message.startswith("3.02 s are missing before row 40 (counted from 0); the log is divided there")
    log = write_log(tmp_path / "log.npz", columns_of(recording.edited(time=time)))
    for extra in ("", '[resample]\nrate = 50.0\nmethod = "linear"'):
        dataset = import_logs([log], load_map(write_map(tmp_path, map_text(extra=extra)))).dataset
        assert dataset.lengths.tolist() == [39, 79] and dataset.tasks == ("log:1", "log:2")
    time[119:] += 3
    write_log(log, columns_of(recording.edited(time=time)))
    result = import_logs([log], load_map(write_map(tmp_path, map_text())))
    assert result.dataset.lengths.tolist() == [39, 78]
    (short,) = [finding for finding in result.findings if finding.check == "too_short"]
    assert short.rows == (119,) and "only 1 row, before which 3.02 s are missing; at least 3" in short.message


def test_one_uneven_step_is_no_range(tmp_path):
    time = motion().time.copy()
    time[40:] += 0.02
    (finding,) = findings(tmp_path, motion().edited(time=time))
    assert "is 40 ms instead of 20 ms" in finding.message


def test_a_position_that_is_frozen_while_its_velocity_runs_is_reported_by_row(tmp_path):
    recording = motion(rows=400, amplitude=1.0)
    position = recording.position.copy()
    position[100:250, 1] = position[100, 1]
    found = findings(tmp_path, recording.edited(position=position))
    (finding,) = [finding for finding in found if finding.check == "position_contradicts_velocity"]
    assert "the position of elbow" in finding.message and set(range(101, 250)) <= set(finding.rows)
    always = recording.edited(position=recording.position * [1, 0])
    found = findings(tmp_path, always)
    assert {finding.check for finding in found} == {"position_contradicts_velocity", "frozen_reading"}
    assert all(len(finding.rows) > 300 for finding in found)


def test_a_position_that_is_another_joints_is_reported(tmp_path):
    recording = motion(rows=400)
    found = findings(tmp_path, recording.edited(position=recording.position[:, [0, 0]]))
    assert {finding.check for finding in found} == {"position_contradicts_velocity", "joints_swapped"}
    assert all("the position of elbow" in finding.message and not finding.error for finding in found)


def test_joints_that_are_swapped_against_their_commands_are_reported(tmp_path):
    recording = motion(rows=400)
    order = [1, 0]
    swapped = recording.edited(position=recording.position[:, order], velocity=recording.velocity[:, order])
    found = only(findings(tmp_path, swapped), "joints_swapped")
    assert "shoulder follows the command of elbow" in found[0].message and len(found) == 2


def test_joints_with_one_command_for_all_are_not_taken_for_swapped(tmp_path):
    recording = motion(rows=400)
    coupled = {key: getattr(recording, key)[:, [0, 0]] for key in ("position", "velocity", "command")}
    assert findings(tmp_path, recording.edited(**coupled)) == []
    resting = {key: values * [1, 0.02] for key, values in coupled.items()}
    assert findings(tmp_path, recording.edited(**resting)) == []


def test_positions_named_as_commands_are_reported(tmp_path):
    (finding,) = only(findings(tmp_path, motion(), command='column = "q"\nunit = "rad"'), "command_is_position")
    assert "shoulder, elbow" in finding.message and not finding.error


GRIPPER = 'unit = "rad"\n[read.{}.joints.elbow]\nunit = "normalised"\nrange = [0.0, 100.0]\nlow = -0.2\nhigh = 1.7\n'
PERCENT = {
    "position": 'column = "q"\n' + GRIPPER.format("position"),
    "command": 'column = "goal"\n' + GRIPPER.format("command"),
    "velocity": '"derive"',
}


def test_a_normalised_joint_that_hardly_leaves_zero_is_refused_as_radians(tmp_path):
    errors = refused(findings(tmp_path, motion(), **PERCENT), "unit_slip")
    assert "the position of elbow is within ±0.5 as logged" in errors[0].message
    assert "use unit = 'rad' in [read.position.joints.elbow]" in errors[0].message
    allowed = findings(tmp_path, motion(), '[audit]\nallow = ["unit_slip"]', **PERCENT)
    assert not any(finding.error for finding in allowed)


@pytest.mark.parametrize("share", [1.0, 0.002])
def test_a_normalised_joint_that_moves_or_rests_is_no_radian(tmp_path, share):
    recording = motion()
    scale, middle = np.array([1, 80 * share]), np.array([0, 50])
    moving = recording.edited(position=recording.position * scale + middle, command=recording.command * scale + middle)
    assert not [finding for finding in findings(tmp_path, moving, **PERCENT) if finding.error]


def test_a_closed_gripper_beside_joints_in_degrees_is_no_radian(tmp_path):
    recording = motion()
    scale = np.array([57, 1.0])
    changes = {key: text.replace('"rad"', '"deg"', 1) for key, text in PERCENT.items()}
    degrees = recording.edited(position=recording.position * scale, command=recording.command * scale)
    assert not [finding for finding in findings(tmp_path, degrees, **changes) if finding.error]


FIRES = {
    "commands": "test_a_command_in_another_unit_than_the_position_is_refused",
    "following": "test_joints_that_are_swapped_against_their_commands_are_reported",
    "finite": "test_values_that_are_not_finite_are_refused_by_row",
    "jumps": "test_jumps_are_reported_by_joint_and_row",
    "limits": "test_values_beyond_the_limits_are_reported_by_joint_and_row",
    "repeats": "test_single_repeated_samples_are_reported_by_row",
    "timing": "test_time_that_goes_back_is_refused_by_row",
    "torque_off": "test_rows_without_torque_are_reported",
    "travel": "test_a_position_that_is_frozen_while_its_velocity_runs_is_reported_by_row",
    "unit_slip": "test_degrees_read_as_radians_are_refused_with_the_remedy",
    "velocity": "test_a_velocity_register_in_another_unit_is_refused",
}


def test_every_audit_of_the_folder_has_a_test_in_which_it_fires():
    assert set(registry.list_names("dataset.audits")) == set(FIRES)
    assert all(name in globals() and find_audit(audit_name).check for audit_name, name in FIRES.items())


def test_every_error_that_a_map_may_allow_becomes_a_warning(tmp_path):
    recording = motion(amplitude=0.1)
    spoilt = {
        "command_scale": (recording.edited(command=np.degrees(recording.command)), {}),
        "rate": (recording.edited(time=recording.time * 2), {"velocity": '"derive"'}),
        "unit_slip": (recording, {"position": 'column = "q"\nunit = "deg"'}),
        "velocity_scale": (recording.edited(velocity=np.degrees(recording.velocity)), {}),
    }
    assert {*spoilt, "unmatched_ends"} == set(ALLOWABLE)  # which needs two files: see test_rows
    for check, (broken, changes) in spoilt.items():
        everything = "[audit]\nmax_speed = 1e6\nallow = " + str([check]).replace("'", '"')
        found = [item for item in findings(tmp_path, broken, everything, **changes) if item.check == check]
        assert found and not any(item.error for item in found), check
