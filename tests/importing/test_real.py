"""Real recordings of an SO-101 arm and an XL330 pendulum import with the shipped maps; audits say what is known."""

import json
import runpy
import shutil
import tomllib
from pathlib import Path

import mujoco
import numpy as np
import pytest
from support.import_samples import REALDATA, write_map

from nas_data.dataset.content import hash_content
from nas_data.errors import LogError
from nas_data.importing.map_file import MAPS, load_map
from nas_data.recorders.logs import import_logs

pytestmark = pytest.mark.skipif(not REALDATA.is_dir(), reason="the real recordings are not beside this checkout")

SO101 = REALDATA / "sage_so101"
XL330 = REALDATA / "bam_xl330"
IN_DEGREES = Path(__file__).parents[2] / "docs/results/so101_lerobot.py"


def changed_map(folder, name: str, *changes: tuple[str, str]):
    """A shipped map with some of its text replaced."""
    text = (MAPS / f"{name}.toml").read_text()
    for before, after in changes:
        assert before in text
        text = text.replace(before, after)
    tomllib.loads(text)
    return load_map(write_map(folder, text))


@pytest.fixture(scope="module")
def arm():
    return import_logs([SO101], load_map("so101_npz"))


@pytest.fixture(scope="module")
def pendulum():
    return import_logs([XL330], load_map("xl330_json"))


def test_all_16_motions_of_the_arm_import(arm):
    files = sorted(SO101.glob("*.npz"))
    dataset = arm.dataset
    assert dataset.tasks == tuple(path.stem for path in files) and len(files) == 16
    assert dataset.lengths.tolist() == [len(np.load(path)["t"]) - 1 for path in files]
    assert dataset.fps == 49.85 and dataset.robot_type == "so101"


def test_positions_and_commands_of_the_arm_are_the_files(arm):
    for index, path in enumerate(sorted(SO101.glob("*.npz"))):
        log, frames = np.load(path), arm.dataset.episode(index)
        np.testing.assert_allclose(arm.dataset.states[frames][:, :5], log["position"][:-1, :5], atol=1e-6)
        np.testing.assert_allclose(arm.dataset.next_states[frames][:, :5], log["position"][1:, :5], atol=1e-6)
        np.testing.assert_allclose(arm.dataset.commands[frames][:, :5], log["action"][:-1, :5], atol=1e-6)
        times = arm.dataset.columns["nas.time"][frames][:, 0]
        np.testing.assert_allclose(times, log["t"][:-1] - log["t"][0], atol=1e-12)


def test_joints_and_gripper_range_are_those_of_the_arms_model(arm):
    model = mujoco.MjModel.from_xml_path(str(SO101 / "model/so101_new_calib_nomesh.xml"))
    names = [model.joint(index).name for index in range(model.njnt)]
    assert set(arm.dataset.joints) == set(names)
    limits = load_map("so101_npz").limits
    for name in names:
        np.testing.assert_allclose(limits[name], model.joint(name).range, atol=1e-9)
    low, high = model.joint("gripper").range
    index = arm.dataset.tasks.index("pick_place")
    raw = np.load(SO101 / "pick_place.npz")["position"][:-1, 5]
    assert np.ptp(raw) > 0.5
    gripper = arm.dataset.states[arm.dataset.episode(index)][:, 5]
    np.testing.assert_allclose(gripper, low + raw * (high - low), atol=1e-6)


def test_the_arms_audits_say_what_is_known_of_it(arm, tmp_path):
    # The shipped map derives velocities; with the register instead, its delay is what there is to say.
    assert {finding.check for finding in arm.findings} == {"repeated_samples"}
    register = changed_map(tmp_path, "so101_npz", ('velocity = "derive"', 'velocity = "measured"'))
    imported = import_logs([SO101], register)
    # No unit is off, also not the gripper's, whose servo turns 1.217 times as far as the model's joint.
    assert {finding.check for finding in imported.findings} == {"velocity_lag", "repeated_samples"}
    late = [finding.message for finding in imported.findings if finding.check == "velocity_lag"]
    assert len(late) == 16 and all("20 ms" in message for message in late)
    assert "velocity_lag: chirp_sweep.npz" in imported.provenance.notes


def test_a_gripper_velocity_in_the_servos_scale_is_noticed(tmp_path):
    plain = changed_map(tmp_path, "so101_npz", ("scale = 0.82176990", "scale = 1.0"))
    found = import_logs([SO101 / "chirp_sweep.npz"], plain).findings
    (scale,) = [finding for finding in found if finding.check == "velocity_scale"]
    assert scale.message.startswith("the velocity of gripper is 1.2") and not scale.error


def test_raw_csv_and_npz_of_one_motion_are_the_same_recording():
    csv = import_logs([SO101 / "raw_csv/step_response"], load_map("so101_csv")).dataset
    npz = import_logs([SO101 / "step_response.npz"], load_map("so101_npz")).dataset
    assert csv.tasks == npz.tasks and csv.features == npz.features
    for key in npz.columns:
        tolerance = 1e-12 if key == "nas.time" else 0  # µs and s differ in the last bit
        np.testing.assert_allclose(csv.columns[key], npz.columns[key], rtol=0, atol=tolerance, err_msg=key)


def test_radians_of_the_arm_taken_for_degrees_are_refused(tmp_path):
    slip = changed_map(tmp_path, "so101_npz", ('unit = "rad"\n', 'unit = "deg"\n'), ('"rad/s"', '"deg/s"'))
    with pytest.raises(LogError, match=r"chirp_sweep.npz: the position of all joints is within ±.*use unit = 'rad'"):
        import_logs([SO101 / "chirp_sweep.npz"], slip)


def test_the_arms_errors_are_the_same_from_lerobots_degrees_as_from_radians(tmp_path):
    pytest.importorskip("lerobot")
    (tmp_path / "model").mkdir()
    shutil.copy(SO101 / "model/so101_new_calib_nomesh.xml", tmp_path / "model")
    for name in ("figure_eight", "pick_place"):
        log = dict(np.load(SO101 / f"{name}.npz"))
        rows = {key: log[key][400:700] for key in ("t", "position", "velocity", "action", "current_torque")}
        np.savez(tmp_path / f"{name}.npz", **{**log, **rows})
    degrees, radians = runpy.run_path(str(IN_DEGREES))["judge_both"](tmp_path, tmp_path / "out")
    for kind in ("one_step", "open_loop"):
        for motion, errors in radians[kind].items():
            assert errors["source"] > 0.05 and degrees[kind][motion] == pytest.approx(errors, abs=1e-4)
    assert len(radians["open_loop"]) == 2


def test_degrees_of_the_arm_taken_for_radians_are_refused(tmp_path):
    log = dict(np.load(SO101 / "figure_eight.npz"))
    for key in ("position", "action", "velocity"):
        log[key] = np.hstack([np.degrees(log[key][:, :5]), log[key][:, 5:]])
    np.savez(tmp_path / "degrees.npz", **log)
    with pytest.raises(
        LogError, match=r"degrees.npz: the position of shoulder_pan reaches .*unit in \[read.position\]"
    ):
        import_logs([tmp_path / "degrees.npz"], load_map("so101_npz"))


def test_commands_beyond_the_arms_limits_are_reported(tmp_path):
    log = dict(np.load(SO101 / "figure_eight.npz"))
    log["action"][100:110, 2] = 1.8
    np.savez(tmp_path / "far.npz", **log)
    found = import_logs([tmp_path / "far.npz"], load_map("so101_npz")).findings
    (beyond,) = [finding for finding in found if finding.check == "command_beyond_limits"]
    assert beyond.rows == tuple(range(100, 110)) and "elbow_flex" in beyond.message


def test_all_12_logs_of_the_pendulum_import_evenly_spaced(pendulum):
    dataset = pendulum.dataset
    gains, trajectories = (100, 200, 400, 800), ("sin_sin", "lift_and_drop", "up_and_down")
    assert set(dataset.tasks) == {f"{name} kp={gain}" for gain in gains for name in trajectories}
    assert dataset.n_episodes == 12 and dataset.joints == ("pendulum",) and dataset.fps == 200
    for index, frames in enumerate(dataset.episodes()):
        np.testing.assert_allclose(dataset.columns["nas.time"][frames][:, 0], np.arange(dataset.lengths[index]) / 200)
        assert f"kp={dataset.columns['nas.p_gain'][frames][0, 0]:.0f}" in dataset.tasks[index]
    constants = [episode["constants"] for episode in pendulum.provenance.target["episodes"]]
    assert all(held["mass"] == 0.49 and held["length"] == 0.1 and held["vin"] == 7.4 for held in constants)


def test_resampled_pendulum_positions_stay_within_an_encoder_step_of_the_log(pendulum):
    for index, path in enumerate(sorted(XL330.glob("2026*.json"))):
        entries = json.loads(path.read_text())["entries"]
        time = np.array([entry["timestamp"] for entry in entries])
        position = np.array([entry["position"] for entry in entries])
        frames = pendulum.dataset.episode(index)
        times = pendulum.dataset.columns["nas.time"][frames][:, 0]
        nearest = np.abs(time - time[0] - times[:, None]).argmin(axis=1)
        moved = np.abs(np.gradient(position, time))[nearest] * 0.0036  # at most half a row of 7.2 ms away
        error = np.abs(pendulum.dataset.states[frames][:, 0] - position[nearest])
        assert (error <= moved + 2 * np.pi / 4096).all()


def test_the_pendulums_load_is_a_signed_duty(pendulum):
    load = pendulum.dataset.columns["nas.load"]
    assert -1 <= load.min() < -0.2 and 0.2 < load.max() <= 1
    first = json.loads(min(XL330.glob("2026*.json")).read_text())["entries"]
    counts = np.array([entry["load"] for entry in first], float)
    expected = (np.where(counts > 32767, counts - 65536, counts) / 885).astype(np.float32)
    found = load[pendulum.dataset.episode(0)][:, 0]
    np.testing.assert_allclose(np.abs(found[:, None] - expected).min(axis=1), 0, atol=1e-6)


def test_the_pendulums_released_rows_are_told_apart(pendulum):
    off = [finding for finding in pendulum.findings if finding.check == "torque_off"]
    assert len(off) == 4  # one a gain: lift_and_drop
    assert {finding.check for finding in pendulum.findings} == {"torque_off", "repeated_samples"}
    released = pendulum.dataset.columns["nas.torque_enable"][:, 0] == 0
    assert 0.2 < released.mean() < 0.25  # 4 s of 6 in four of twelve logs


def test_the_pendulums_late_register_is_why_its_velocities_are_derived(tmp_path):
    measured = changed_map(tmp_path, "xl330_json", ('velocity = "derive"', 'velocity = "measured"'))
    found = import_logs([XL330 / "2026-01-15_10h29m14.json"], measured).findings
    (late,) = [finding for finding in found if finding.check == "velocity_lag"]
    assert "1" in late.message and "ms behind the position" in late.message


def test_the_pendulum_without_resampling_is_uneven_where_the_torque_is_off(tmp_path):
    uneven = changed_map(tmp_path, "xl330_json", ('[resample]\nrate = 200.0 # [Hz]\nmethod = "linear"', ""))
    sine = import_logs([XL330 / "2026-01-15_10h29m14.json"], uneven)
    assert sine.dataset.fps == 188 and "torque_off" not in {finding.check for finding in sine.findings}
    with pytest.raises(LogError, match=r"rows come at 28\d.* Hz, but the map says 188 Hz; .*add \[resample\]"):
        import_logs([XL330 / "2026-01-15_10h29m21.json"], uneven)


def test_importing_again_gives_the_same_content(pendulum):
    again = import_logs([XL330], load_map("xl330_json"))
    assert hash_content(again.dataset) == hash_content(pendulum.dataset)


def test_a_json_file_that_is_no_log_is_refused():
    with pytest.raises(Exception, match=r"m1.json has no key 'entries'.*it has: kt"):
        import_logs([XL330 / "identified_params_from_this_recording_m1.json"], load_map("xl330_json"))
