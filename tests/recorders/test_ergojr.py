"""Recordings of a virtual ErgoJr: sound, resumable whatever ends them, and the arm is safe afterwards."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from support.xl320_samples import be_patient, be_quick, torques, virtual

from nas_data.cli import main
from nas_data.command_file import write_commands
from nas_data.dataset.features import ACTION, NEXT_STATE, STATE, TIME
from nas_data.dataset.incremental_writer import IncrementalWriter
from nas_data.dataset.provenance import read_provenance
from nas_data.dataset.read import read
from nas_data.dataset.verify import verify
from nas_data.dataset.write_lock import hold_write_lock
from nas_data.effects.base import make_effect
from nas_data.errors import BeingWritten, GuardLost, ServoSilent
from nas_data.excitations.base import parse
from nas_data.hardware.arms.base import Reading
from nas_data.hardware.arms.line import LENIENCE
from nas_data.hardware.virtual_bus.process import VirtualBus
from nas_data.hardware.virtual_bus.terminal import Options
from nas_data.hardware.xl320.arm import Xl320, Xl320Arm
from nas_data.hardware.xl320.control_table import SPEED_UNIT, TICK
from nas_data.hardware.xl320.joints import make_ergojr_joints, write_calibration
from nas_data.recorders.arm_dataset import LATE, LOAD, REPEATED, TEMPERATURE, VOLTAGE
from nas_data.recorders.arm_motion import ArmEpisode
from nas_data.recorders.arm_plan import MotionLimits, MotionPlan, draw_plan, free_of_contact, limit_steps, plan_key
from nas_data.recorders.guarded import GuardedArm
from nas_data.recorders.path_planner import PathPlanner
from nas_data.recorders.session import PlaybackProtocol
from nas_data.recorders.watchdog import DIED, HUNG, LineReader, Watchdog, rescue, watch
from nas_data.robots.base import find_robot
from nas_data.simulators.contact import count_contacts
from nas_data.simulators.mujoco import MujocoSimulator

JOINTS = make_ergojr_joints()
ROBOT = find_robot("ergojr")
SHORT = ("--seconds", "0.3", "--excitation", "steps:share=0.2,seconds=0.1", "--name", "rec")
LOCKSTEP = ("--port", "virtual", "--lockstep")
UNDER_WAY = Path("datasets/rec/recording")


@pytest.fixture(autouse=True)
def _patient(monkeypatch) -> None:
    be_patient(monkeypatch)
    be_quick(monkeypatch)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HF_LEROBOT_CALIBRATION", str(tmp_path / "calibration"))
    return tmp_path


def record(*options: str) -> int:
    return main(["record", "ergojr", *SHORT, *options])


def finished() -> Path:
    (path,) = Path("datasets/rec").glob("v1-*")
    return path


@pytest.fixture(scope="module")
def bus() -> Iterator[VirtualBus]:
    """Return a sound arm that each test leaves without torque, and to which no driver is connected."""
    with virtual() as bus:
        yield bus


# What is recorded


def test_a_recording_is_a_sound_dataset_with_its_history(capsys):
    assert record(*LOCKSTEP, "--episodes", "2", "--effect", "backlash:joint=m3,half_width=0.03", "--json") == 0
    answer = json.loads(capsys.readouterr().out)
    root = finished()
    dataset, provenance = read(root), read_provenance(root)
    assert answer["frames"] == dataset.n_frames == 60
    assert answer["late"] == answer["missed"] == answer["repeated"] == 0
    assert verify(root) == []
    assert dataset.joints == ROBOT.joints
    assert dataset.columns[TIME][:30, 0] == pytest.approx(np.arange(30) / 100)
    for rows in dataset.episodes():
        assert np.array_equal(dataset.columns[STATE][rows][1:], dataset.columns[NEXT_STATE][rows][:-1])
    assert provenance.how == "simulated"
    assert provenance.seeds == (0,)
    assert provenance.target["effects"][0]["effect"] == "backlash"
    assert provenance.target["configuration"]["registers"]["moving_speed"] == 150
    assert provenance.target["tally"]["sittings"] == 1
    assert not UNDER_WAY.exists()
    check_readings(dataset)


def check_readings(dataset) -> None:
    """Check that positions are whole ticks, and that everything else is kept."""
    positions = dataset.states[:, :6] / TICK
    assert positions == pytest.approx(np.rint(positions), abs=1e-3)
    assert np.ptp(positions, axis=0).max() > 5
    assert np.abs(dataset.columns[LOAD]).max() > 0.05
    assert 6 < dataset.columns[VOLTAGE].min() <= dataset.columns[VOLTAGE].max() <= 7.4
    assert 20 < dataset.columns[TEMPERATURE].min() <= dataset.columns[TEMPERATURE].max() < 40
    assert dataset.columns[LATE].max() == dataset.columns[REPEATED].max() == 0


def test_the_virtual_arm_moves_as_its_model_does_at_the_servos_speed():
    assert record(*LOCKSTEP, "--episodes", "1", "--seconds", "1", "--excitation", "steps:share=0.5") == 0
    dataset = read(finished())
    speed = 150 * SPEED_UNIT  # what the moving speed register holds
    effects = [make_effect("speed_limit", joint, {"speed": speed}) for joint in ROBOT.joints]
    simulator = MujocoSimulator(ROBOT, 0.01, effects=effects, threads=1)
    commands = dataset.commands.reshape(1, 100, 6).astype(float)
    first = dataset.states.reshape(1, 100, 12)[:, 0].astype(float)
    first[:, 6:] = 0
    rest = np.zeros((1, 50, 6))  # the pose that the arm held before
    simulated = simulator.rollout(first, np.concatenate([rest, commands], axis=1))[:, 50:, :6]
    error = simulated - dataset.next_states.reshape(1, 100, 12)[..., :6]
    assert np.sqrt(np.square(error).mean()) < 1.5 * TICK


def test_effects_are_kept_secret_where_they_are_to_be_found_and_a_step_is_no_larger_than_allowed():
    secret = ("--effect", "backlash:joint=m3,half_width=0.03", "--blind")
    assert record(*LOCKSTEP, "--episodes", "1", *secret, "--largest-step", "0.01") == 0
    assert "backlash" not in (finished() / "meta/nas.json").read_text()
    assert np.abs(np.diff(read(finished()).columns[ACTION], axis=0)).max() < 0.01 + TICK


def test_a_joint_far_from_the_pose_to_which_it_went_is_reported_once(capsys):
    assert record(*LOCKSTEP, "--episodes", "2", "--effect", "joint_offset:joint=m1,offset=0.4") == 0
    behind = re.findall(r"(m\d) stays (\d\d)\.\d° from a pose", capsys.readouterr().err)
    assert behind == [("m1", "27")]  # the offset and the dead band


def test_a_file_of_commands_is_played_as_it_is(folder):
    commands = np.linspace(0, 0.2, 20)[:, None] * np.ones(6)
    write_commands(Path("moves.csv"), [f"{joint}.pos" for joint in ROBOT.joints], [commands])
    assert record(*LOCKSTEP, "--commands", "moves.csv") == 0
    assert read(finished()).commands == pytest.approx(commands, abs=TICK / 2)


def test_a_slow_arm_is_at_its_first_pose_when_an_episode_begins(monkeypatch):
    monkeypatch.setattr("nas_data.recorders.arm_motion.APPROACH", 0.6)  # as of a real arm
    for limit in (("--speed", "0.3"), ("--largest-step", "0.003")):
        assert record(*LOCKSTEP, "--episodes", "1", "--seconds", "0.2", *limit, "--name", limit[0].strip("-")) == 0
        (root,) = Path(f"datasets/{limit[0].strip('-')}").glob("v1-*")
        assert np.abs(read(root).states[0, :6]).max() < 0.25  # the sag of the shoulder


def test_a_search_for_a_path_has_time(monkeypatch):
    asked, find = [], PathPlanner.find
    monkeypatch.setattr(GuardedArm, "extend_deadline", lambda arm, seconds: asked.append(seconds))
    monkeypatch.setattr(PathPlanner, "find", lambda *given: asked.append("find") or find(*given))
    assert record(*LOCKSTEP, "--episodes", "1") == 0
    before = [one for one, next_one in pairwise(asked) if next_one == "find"]
    assert len(before) > 1 and min(before) >= 10


def test_a_recording_is_not_continued_with_other_steps(capsys):
    record_until("adapter_pulled", 6)
    capsys.readouterr()
    assert record(*LOCKSTEP, "--episodes", "6", "--largest-step", "0.01") == 2
    assert "other options" in capsys.readouterr().err


# What is planned


def test_steps_are_limited_as_the_arm_limits_them():
    commands = np.array([[[1.0, 0.1], [1.0, 0.1], [-1.0, 0.1]]])
    sent = limit_steps(commands, np.zeros((1, 2)), np.array([0.4, 0.06]))
    assert sent[0] == pytest.approx(np.array([[0.4, 0.06], [0.8, 0.1], [0.4, 0.1]]))
    assert np.array_equal(limit_steps(commands, np.zeros((1, 2)), np.inf), commands)


def test_small_steps_are_simulated_before_they_are_sent():
    """Slow commands take the straight way between poses, which fast ones do not."""
    protocol = PlaybackProtocol(excitation=parse("steps"), episodes=24, seconds=2.0)
    simulator = MujocoSimulator(ROBOT, 0.01, threads=1)
    for step in (3.2, 0.01):
        plan = draw_plan(ROBOT, protocol, MotionLimits(100.0, 0.0, step))
        path = simulator.rollout(np.zeros((24, 12)), limit_steps(plan.commands, plan.poses, step))[..., :6]
        assert count_contacts(simulator, path[:, ::3].reshape(-1, 6)).max() == 0
    keys = {plan_key(ROBOT, protocol, MotionLimits(100.0, 0.0, step)) for step in (3.2, 0.01)}
    assert len(keys) == 2 and plan.key in keys


def test_planned_episodes_touch_nothing():
    protocol = PlaybackProtocol(excitation=parse("steps"), episodes=12, seconds=2.0)
    plan = draw_plan(ROBOT, protocol, MotionLimits(100.0, 1.745, 3.2))
    assert plan.commands.shape == (12, 200, 6)
    assert plan.replaced > 0
    assert count_contacts(MujocoSimulator(ROBOT, 0.01, threads=1), plan.commands[:, 99]).tolist() == [0] * 12
    for again in (MotionPlan.from_bytes(plan.to_bytes()), draw_plan(ROBOT, protocol, MotionLimits(100.0, 1.745, 3.2))):
        assert (again.key, again.task, again.replaced) == (plan.key, plan.task, plan.replaced)
        assert np.array_equal(again.commands, plan.commands)
        assert np.array_equal(again.poses, plan.poses)
    assert draw_plan(ROBOT, replace(protocol, seed=1), MotionLimits(100.0, 1.745, 3.2)).key != plan.key


def test_an_episode_that_reaches_the_floor_is_not_free():
    simulator = MujocoSimulator(ROBOT, 0.01, threads=1)
    down = np.tile([0, 1.5, 0.8, 0, 0, 0], (150, 1))
    assert count_contacts(simulator, down[:1])[0] > 0
    assert free_of_contact(simulator, np.stack([down, 0 * down]), np.zeros((2, 6)), PathPlanner(ROBOT)).tolist() == [
        False,
        True,
    ]


def test_a_file_that_reaches_the_floor_is_refused(capsys):
    down = np.tile([0, 1.5, 0.8, 0, 0, 0], (150, 1))
    write_commands(Path("moves.csv"), [f"{joint}.pos" for joint in ROBOT.joints], [0 * down, down])
    assert record(*LOCKSTEP, "--commands", "moves.csv") == 2
    assert "moves.csv: in episode 1 the arm would touch itself or the floor" in capsys.readouterr().err
    assert not Path("datasets").exists()


# Flags


def reading(when: float, raw: bytes = b"", moving: bool = True) -> Reading:
    return Reading(when, np.zeros(6), np.full(6, float(moving)), np.zeros(6), raw, ())


def test_late_missed_and_repeated_readings_are_told_apart():
    readings = [reading(0.001, b"a"), reading(0.014, b"b"), reading(0.021, b"b"), reading(0.045, b"c")]
    readings += [reading(0.041, b"d", moving=False), reading(0.051, b"d", moving=False)]
    episode = ArmEpisode(due=[0.0, 0.01, 0.02, 0.03, 0.04, 0.05], readings=readings)
    assert episode.late(0.01).tolist() == [False, True, False, True, False, False]
    assert episode.missed(0.01).tolist() == [False, False, False, True, False, False]
    assert episode.repeated().tolist() == [False, False, True, False, False, False]


def test_an_arm_that_is_slower_than_the_recorder_is_found_out(capsys):
    # registers that are renewed only every other reading, as the authors' recordings had them
    assert record(*LOCKSTEP, "--episodes", "1", "--excitation", "sine:share=0.3", "--fault", "stale:every=2") == 0
    assert "warning: " in (said := capsys.readouterr().out)
    assert "repeat the previous one while the arm moves" in said
    assert read(finished()).columns[REPEATED].mean() > 0.2


# What goes wrong


def record_until(fault: str, episodes: int, *options: str) -> None:
    """Record until a fault, which comes later each time until something is saved before it."""
    word = "," if ":" in fault else ":"
    for after in (3, 5, 8, 13, 21):
        late = ("--episodes", str(episodes), "--fault", f"{fault}{word}after={after}")
        assert record(*LOCKSTEP, *late, *options) == 2
        if UNDER_WAY.exists():
            return


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        pytest.param("adapter_pulled", "vanished while it was used", marks=pytest.mark.slow),
        pytest.param("unplugged:servo=3", "Servo 3 does not answer", marks=pytest.mark.slow),
        ("overload:servo=2", "Servo 2 (m2) shut down by overload"),
        pytest.param("overheat:servo=4", "Servo 4 (m4) shut down at 80 °C", marks=pytest.mark.slow),
        pytest.param("undervoltage", "an XL-320 needs 6 V", marks=pytest.mark.slow),
        pytest.param("lost_packet:share=1", "No servo answers", marks=pytest.mark.slow),
    ],
)
def test_a_fault_ends_in_one_sentence_and_what_is_saved_is_kept(capfd, monkeypatch, fault, words):
    be_patient(monkeypatch, LENIENCE)  # each silence costs it
    record_until(fault, episodes=12)
    said = capfd.readouterr().err.splitlines()[-1]
    assert said.startswith("nas: ")
    assert words in said
    assert "run the same command to continue" in said
    kept = read(UNDER_WAY)
    assert 0 < kept.n_episodes < 12
    assert f"{kept.n_episodes} of 12 episodes are saved" in said


def test_a_recording_goes_on_after_a_fault_as_if_nothing_had_happened(folder, capsys, monkeypatch):
    record_until("adapter_pulled", episodes=6)
    before = read(UNDER_WAY)
    assert 0 < before.n_episodes < 6
    assert record(*LOCKSTEP, "--episodes", "6", "--seed", "1") == 2
    assert "was started with other options" in capsys.readouterr().err
    shutil.copytree("datasets", "copy/datasets", symlinks=True)
    monkeypatch.chdir("copy")
    assert record(*LOCKSTEP, "--episodes", "6", "--finish") == 0
    assert read(finished()).n_episodes == before.n_episodes
    assert verify(finished()) == []
    monkeypatch.chdir(folder)
    assert record(*LOCKSTEP, "--episodes", "6") == 0
    whole = read(finished())
    assert whole.n_episodes == 6
    assert verify(finished()) == []
    assert np.array_equal(whole.columns[STATE][: before.n_frames], before.columns[STATE])
    assert read_provenance(finished()).target["tally"]["sittings"] == 2
    plan = draw_plan(ROBOT, protocol_of_short(6), MotionLimits(100.0, 1.745, 3.2))
    assert whole.commands == pytest.approx(plan.commands.reshape(-1, 6), abs=TICK / 2)


def test_a_recording_is_resumed_with_an_equal_calibration_only(folder, capsys):
    offsets = (0, 4, 0, 0, 0, -3)
    for name, joints in (("one", offsets), ("equal", offsets), ("other", (0, 5, 0, 0, 0, -3))):
        write_calibration(folder / f"{name}.json", make_ergojr_joints(joints))
    record_until("adapter_pulled", 6, "--calibration", "one.json")
    capsys.readouterr()
    resumed = (*LOCKSTEP, "--episodes", "6", "--calibration")
    assert record(*resumed, "other.json") == 2
    assert "was started with another calibration; give the same to continue" in capsys.readouterr().err
    assert record(*resumed, "equal.json") == 0
    assert read_provenance(finished()).target["zero_offsets_ticks"] == list(offsets)


def protocol_of_short(episodes: int) -> PlaybackProtocol:
    return PlaybackProtocol(excitation=parse("steps:share=0.2,seconds=0.1"), episodes=episodes, seconds=0.3)


def test_a_bad_line_costs_attempts_but_no_wrong_value(monkeypatch):
    be_patient(monkeypatch, LENIENCE)
    faults = ("--fault", "lost_packet:share=0.003", "--fault", "corrupted_packet:share=0.003")
    assert record(*LOCKSTEP, "--episodes", "3", *faults) == 0
    dataset, tally = read(finished()), read_provenance(finished()).target["tally"]
    assert dataset.n_episodes == 3
    assert tally["retries"] > 0
    steps = np.abs(dataset.next_states[:, :6] - dataset.states[:, :6]).max()
    assert steps < 0.1  # at 1.75 rad/s an arm cannot go farther in a period, but for a lost one now and then
    assert verify(finished()) == []


@pytest.mark.parametrize(("times", "outcome"), [(2, 0), (3, 2)])
def test_an_arm_that_goes_unheard_while_it_is_taken_is_taken_again(monkeypatch, times, outcome):
    configure, failed = Xl320Arm.configure, []

    def sometimes(arm):
        if len(failed) < times:
            failed.append(True)
            raise ServoSilent("Servo 3 does not answer.")
        configure(arm)

    monkeypatch.setattr(Xl320Arm, "configure", sometimes)
    assert record(*LOCKSTEP, "--episodes", "1") == outcome
    assert len(failed) == times


def test_a_hot_arm_rests(capfd):
    hot = ("--fault", "overheat:celsius=58,after=2", "--fault", "overheat:celsius=30,after=5")
    assert record(*LOCKSTEP, "--episodes", "4", *hot) == 0
    assert "A servo has 58 °C; the arm pauses until it is cooler." in capfd.readouterr().err
    assert read_provenance(finished()).target["tally"]["pauses"] == 1


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--port", "/dev/nowhere"), "There is no port /dev/nowhere"),
        ((*LOCKSTEP, "--episodes", "0"), "0 episodes"),
        ((*LOCKSTEP, "--rate", "5000"), "--rate is 5000"),
        ((*LOCKSTEP, "--speed", "-1"), "speed limit is -1"),
        ((*LOCKSTEP, "--largest-step", "inf"), "--largest-step is inf"),
        ((*LOCKSTEP, "--torque", "0"), "torque limit is 0"),
        ((*LOCKSTEP, "--hot", "90"), "--hot is 90; it must be in 35 … 64 °C"),
        ((*LOCKSTEP, "--hot", "20"), "--hot is 20"),
        ((*LOCKSTEP, "--effect", "backlash:joint=m9,half_width=0.03"), "names the joint 'm9'"),
        ((*LOCKSTEP, "--fault", "unplugged:servo=12"), "names servo 12"),
        ((*LOCKSTEP, "--p-gain", "300"), "p_gain is 300"),
        ((*LOCKSTEP, "--excitation", "dance"), "dance"),
        ((*LOCKSTEP, "--calibration", "absent.json"), "absent.json is not a calibration"),
        ((*LOCKSTEP, "--finish"), "There are no saved episodes in"),
        ((*LOCKSTEP, "--joints", "m9"), "no joint 'm9'"),
        (
            (*LOCKSTEP, "--commands", "moves.csv", "--joints", "m1"),
            "--joints has no effect on the commands of moves.csv",
        ),
        ((*LOCKSTEP, "--excitation", "sine:slowest=2"), "slowest is 2 Hz, above fastest, 1 Hz"),
        ((*LOCKSTEP, "--excitation", "babbling:every=inf"), "every is inf; it must be a whole number"),
    ],
)
def test_bad_input_costs_one_sentence_and_writes_nothing(capfd, monkeypatch, options, words):
    be_patient(monkeypatch, LENIENCE)
    assert record(*options) == 2
    lines = capfd.readouterr().err.splitlines()
    assert len(lines) == 1
    assert words in lines[0]
    assert not Path("datasets").exists()


# Two at once


def test_a_name_is_recorded_by_one_program_at_a_time(capsys):
    with hold_write_lock(UNDER_WAY):
        assert record(*LOCKSTEP, "--episodes", "1") == 2
        assert f"is being written by another program (process {os.getpid()}); wait" in capsys.readouterr().err
    assert not Path("datasets").exists()
    assert record(*LOCKSTEP, "--episodes", "1") == 0
    assert [path.name for path in Path("datasets/rec").iterdir()] == [finished().name]


def test_a_lock_that_a_dead_program_left_holds_nobody_up():
    UNDER_WAY.parent.mkdir(parents=True)
    UNDER_WAY.with_name(".recording.lock").write_text("1")
    with (
        hold_write_lock(UNDER_WAY),
        pytest.raises(BeingWritten, match=rf"\(process {os.getpid()}\)"),
        hold_write_lock(UNDER_WAY),
    ):
        pass
    assert list(UNDER_WAY.parent.iterdir()) == []


def test_a_port_is_used_by_one_program_at_a_time(bus, capsys):
    with Xl320Arm(bus.port, JOINTS):
        assert record("--port", bus.port, "--episodes", "1") == 2
        assert f"{bus.port} is used by another program" in capsys.readouterr().err
    assert not Path("datasets").exists()


# Who dies


@contextmanager
def recorder(port: str, episodes: int, *options: str) -> Iterator[subprocess.Popen]:
    """Record in a process of its own."""
    command = [sys.executable, "-m", "nas_data", "record", "ergojr", "--port", port, *SHORT]
    command += ["--episodes", str(episodes), *options]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def wait_for(condition, seconds: float = 200.0) -> None:
    until = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < until
        time.sleep(0.02)


def free(port: str) -> bool:
    try:
        Xl320Arm(port, JOINTS).close()
    except Exception:
        return False
    return True


def saved() -> int:
    return read(UNDER_WAY).n_episodes if UNDER_WAY.exists() else 0


def test_a_killed_recorder_loses_nothing_and_leaves_no_torque():
    with VirtualBus(Options(wire_delay=False)) as bus:
        with recorder(bus.port, 9) as process:
            wait_for(lambda: saved() >= 1 or process.poll() is not None)
            assert process.poll() is None, process.communicate()
            os.kill(process.pid, signal.SIGKILL)
            process.wait()
            kept = saved()
        wait_for(lambda: free(bus.port) and torques(bus.port) == [0] * 6, 60)
        assert kept >= 1
        assert saved() == kept


def test_ctrl_c_makes_the_arm_safe_and_says_what_is_saved(bus, capfd, monkeypatch):
    append = IncrementalWriter.append

    def interrupted(*arguments) -> None:
        append(*arguments)
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(IncrementalWriter, "append", interrupted)
    assert record("--port", bus.port, "--episodes", "9") == 130
    assert "1 of 9 episodes are saved in datasets/rec/recording" in capfd.readouterr().err
    assert torques(bus.port) == [0] * 6
    assert saved() == 1


@pytest.mark.slow
@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGTERM])
def test_a_recorder_that_is_told_to_stop_makes_the_arm_safe_first(end):
    with VirtualBus(Options(wire_delay=False)) as bus:
        with recorder(bus.port, 60) as process:
            wait_for(lambda: saved() >= 1)
            process.send_signal(end)
            _, said = process.communicate(timeout=120)
        assert process.returncode == 130
        assert "episodes are saved in datasets/rec/recording" in said
        assert torques(bus.port) == [0] * 6


@pytest.mark.slow
def test_a_recorder_that_hangs_is_ended_and_leaves_no_torque():
    with VirtualBus(Options(wire_delay=False)) as bus:
        with recorder(bus.port, 60) as process:
            wait_for(lambda: saved() >= 1)
            time.sleep(0.5)  # saving may take longer than moving without a word
            os.kill(process.pid, signal.SIGSTOP)
            kept = saved()
            assert process.wait(timeout=60) == -signal.SIGKILL
            process.stdout.close()
            said = process.stderr.readline()  # the guard inherited it
            while "hung" not in said:
                said = process.stderr.readline()
        assert (
            f"The recorder did not respond for 1 s and was ended; the torque of the arm on {bus.port} was switched off."
        ) in said
        assert torques(bus.port) == [0] * 6
        assert saved() == kept


def test_a_guard_listens_to_promises():
    reader, writer = os.pipe()
    try:
        os.write(writer, b"0.2\n")
        began = time.monotonic()
        assert watch(LineReader(reader), []) == HUNG
        assert 1.2 <= time.monotonic() - began < 5
        assert watch(LineReader(reader), [b"0.1"]) == HUNG
        os.write(writer, b"0.2\n30.0\nall is ")
        os.write(writer, b"well\n")
        assert watch(LineReader(reader), []) == ""
        os.write(writer, b"30.0\n")
    finally:
        os.close(writer)
    assert watch(LineReader(reader), []) == DIED
    os.close(reader)


def test_an_arm_is_not_moved_without_its_guard(bus):
    watchdog = Watchdog(Xl320(port=bus.port, joints=JOINTS))
    watchdog._process.kill()
    watchdog._process.wait()
    with pytest.raises(GuardLost, match="watchdog process of the arm ended"):
        watchdog.extend_deadline(1.0)
    watchdog.release()


def test_a_guard_that_is_released_does_nothing(bus):
    with Xl320Arm(bus.port, JOINTS) as arm:
        arm.configure()
        arm.torque_on()
        with Watchdog(Xl320(port=bus.port, joints=JOINTS)):
            pass
        assert [arm.bus.get(identity, "torque_enable") for identity in JOINTS.ids] == [1] * 6


def test_a_rescue_says_what_it_did(bus, monkeypatch):
    monkeypatch.setattr("nas_data.recorders.watchdog.PATIENCE", 0.2)
    arm = Xl320Arm(bus.port, JOINTS)
    arm.configure()
    arm.torque_on()
    arm.close()
    assert "the torque of the arm on" in rescue(bus.port, Xl320(port=bus.port, joints=JOINTS).opener())
    assert torques(bus.port) == [0] * 6
    assert "switch the supply off" in rescue("/dev/nowhere", Xl320(port="/dev/nowhere", joints=JOINTS).opener())
