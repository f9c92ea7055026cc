"""Recordings of arms that LeRobot drives: in radians whatever its units, whole whatever fails, and safe afterwards."""

import contextlib
import multiprocessing
import os
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("lerobot")

from support.lerobot_arm_samples import PERIOD, ROBOT, driver, read_sources_once, torques, virtual
from support.xl320_samples import be_quick

from nas_data import errors
from nas_data.cli import main
from nas_data.commands.record_lerobot import RecordLerobot
from nas_data.dataset.features import ACTION, NEXT_STATE, STATE, TIME
from nas_data.dataset.provenance import read_provenance
from nas_data.dataset.read import read
from nas_data.dataset.verify import verify
from nas_data.effects.base import make_effect
from nas_data.hardware.arms.line import Register
from nas_data.recorders import watchdog
from nas_data.recorders.arm import Settings
from nas_data.recorders.arm_dataset import LATE, LOAD, TEMPERATURE, VOLTAGE
from nas_data.recorders.lerobot_arm import LeRobotDriver
from nas_data.robots.so101_follower import QUANTUM
from nas_data.simulators.mujoco import MujocoSimulator

SO101 = ("--robot.type", "so101_follower", "--port", "virtual", "--lockstep")
RUBBING = ("--episodes", "2", "--seconds", "1.2", "--effect", "coulomb_friction:joint=shoulder_lift,torque=0.4")
SLOW = pytest.mark.slow
SHORT = ("--seconds", "0.4", "--name", "rec")
UNDER_WAY = Path("datasets/rec/recording")
DISTURBED = ("lost_packet:share=0.01", "corrupted_packet:share=0.01")
FAULTS = 25
LARGEST_STEP = 0.15  # [rad] of an arm in a period: commands go at 2 rad/s, and two of them may be lost in a row


@pytest.fixture(scope="module", autouse=True)
def _sources() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        read_sources_once(patch)
        yield


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    be_quick(monkeypatch)
    return tmp_path


def record(*options: str) -> int:
    return main(["record", "lerobot", *SHORT, *options])


def finished() -> Path:
    (path,) = Path("datasets/rec").glob("v1-*")
    return path


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> Path:
    """Return two short episodes of a virtual SO-101 in degrees, whose shoulder rubs."""
    place = tmp_path_factory.mktemp("recording") / "rec"
    with pytest.MonkeyPatch.context() as patch:
        be_quick(patch)
        assert main(["record", "lerobot", *SO101, *RUBBING, "--out", str(place)]) == 0
    return place


@pytest.fixture(scope="module")
def bus(tmp_path_factory):
    """Yield a virtual SO-101 and the folder of its calibration."""
    place = tmp_path_factory.mktemp("arm")
    with virtual(place) as bus:
        yield bus, place


# What is recorded


def test_a_recording_is_a_sound_dataset_in_radians_with_the_servos_registers(recording):
    dataset, target = read(recording), read_provenance(recording).target
    assert verify(recording) == []
    assert (dataset.robot_type, dataset.joints, dataset.fps) == ("so101_follower", ROBOT.joints, 50.0)
    assert dataset.features[STATE].units == ("rad",) * 6 + ("rad/s",) * 6
    assert dataset.lengths.tolist() == [60, 60]
    assert dataset.columns[TIME][:60, 0] == pytest.approx(np.arange(60) * PERIOD)
    for rows in dataset.episodes():
        assert np.array_equal(dataset.columns[STATE][rows][1:], dataset.columns[NEXT_STATE][rows][:-1])
    assert np.abs(dataset.states[:, :6] - ROBOT.rest).max() < 3, "an arm near its rest, so not in degrees"
    assert np.abs(dataset.columns[LOAD]).max() > 0.02
    assert 4 < dataset.columns[VOLTAGE].min() <= dataset.columns[VOLTAGE].max() <= 7.4
    assert 20 < dataset.columns[TEMPERATURE].min() <= dataset.columns[TEMPERATURE].max() < 50
    assert dataset.columns[LATE].max() == target["tally"]["missed"] == 0
    assert target["effects"][0]["effect"] == "coulomb_friction"
    (first,) = target["registers"]
    held = first["joints"]["elbow_flex"]
    wanted = {"P_Coefficient": 16, "D_Coefficient": 32, "Acceleration": 254, "CW_Dead_Zone": 1, "Torque_Limit": 1000}
    wanted |= {"Goal_Velocity": 0, "Minimum_Startup_Force": 16, "CCW_Dead_Zone": 1, "Maximum_Acceleration": 254}
    assert first["from_episode"] == 0
    assert {name: held[name] for name in wanted} == wanted
    assert held["Homing_Offset"] == target["calibration"]["elbow_flex"]["homing_offset"] != 0


def test_degrees_and_shares_of_the_range_give_the_same_recording(recording):
    assert main(["record", "lerobot", *SO101, *RUBBING, "--robot.use_degrees=false", "--out", "shares"]) == 0
    units = [read_provenance(root).target["units"]["elbow_flex"] for root in (recording, Path("shares"))]
    assert units == ["degrees", "range_m100_100"]
    one, other = read(recording).columns, read(Path("shares")).columns
    assert all(np.array_equal(one[key], other[key]) for key in (STATE, ACTION, NEXT_STATE))


def test_the_virtual_arm_moves_as_its_model_does_with_the_effect_that_it_was_given(recording):
    dataset = read(recording)
    commands = dataset.commands.reshape(2, 60, 6).astype(float)
    first = dataset.states.reshape(2, 60, 12)[:, 0].astype(float)
    measured = dataset.next_states.reshape(2, 60, 12)[..., :6]
    found = []
    for effects in ([], [make_effect("coulomb_friction", "shoulder_lift", {"torque": 0.4})]):
        simulated = MujocoSimulator(ROBOT, PERIOD, effects=effects, threads=1).rollout(first, commands)[..., :6]
        found.append(np.sqrt(np.square(simulated - measured).mean(axis=(0, 1))))
    without, given = found
    assert given.max() < 6 * QUANTUM
    assert without[1] > 3 * given[1]


def test_a_koch_arm_runs_on_the_dynamixel_bus():
    koch = ("--robot.type", "koch_follower", "--model", "so101_follower", "--port", "virtual", "--lockstep")
    assert record(*koch, "--episodes", "1") == 0
    dataset, target = read(finished()), read_provenance(finished()).target
    assert verify(finished()) == []
    assert target["servos"]["shoulder_pan"] == "xl430-w250" and target["servos"]["gripper"] == "xl330-m288"
    held = target["registers"][0]["joints"]
    assert held["elbow_flex"]["Position_P_Gain"] == 1500  # what LeRobot's class sets
    assert held["wrist_flex"]["Position_P_Gain"] == 400
    assert np.ptp(dataset.states[:, :6], axis=0).min() > 0.05


# What goes wrong


def test_disturbed_packets_yield_no_wrong_value(bus):
    bus, folder = bus
    for fault in ("lost_packet:share=0.1", "corrupted_packet:share=0.1", "latency:share=0.01"):
        bus.inject(fault)
    arm = driver(folder, bus.port).open()
    still, answered = None, 0
    while arm.line.failures < FAULTS:
        try:
            reading = arm.read()
        except (errors.BadReply, errors.ServoSilent, errors.NobodyAnswers) as error:
            assert str(error).endswith(".")
        else:
            still, answered = still or reading.raw, answered + 1  # the torque is off, and no time passes
            assert reading.raw == still
    assert answered > 5
    arm.close()
    bus.repair()


@SLOW
def test_a_bad_line_costs_attempts_but_no_wrong_row():
    faults = [word for fault in DISTURBED for word in ("--fault", fault)]
    assert record(*SO101, "--episodes", "2", *faults) == 0
    dataset = read(finished())
    assert dataset.n_episodes == 2 and verify(finished()) == []
    assert read_provenance(finished()).target["tally"]["retries"] > 0
    assert np.abs(dataset.next_states[:, :6] - dataset.states[:, :6]).max() < LARGEST_STEP


def test_a_command_that_was_lost_is_not_said_to_have_been_given(bus):
    bus, folder = bus
    arm = driver(folder, bus.port).open()
    arm.check()
    arm.configure()
    start = arm.read().positions
    sent = arm.command(start + 0.1)
    assert sent == pytest.approx(start + 0.1, abs=QUANTUM)
    assert arm.read().goals == pytest.approx(sent)
    bus.inject("lost_packet:share=1")
    time.sleep(0.1)
    lost = arm.command(start + 0.2)
    bus.repair()
    time.sleep(0.1)
    assert arm.read().goals == pytest.approx(sent)
    assert sent != pytest.approx(lost, abs=0.05)
    assert arm.find_unconfirmed() == list(arm.ids)
    arm.torque_off()
    assert arm.find_unconfirmed() == []
    arm.close()


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("adapter_pulled:after=2", "vanished while it was used"),
        pytest.param("overload:servo=2,after=6", "Servo 2 (shoulder_lift) shut down by overload", marks=SLOW),
        pytest.param("unplugged:servo=3,after=6", "Servo 3 does not answer", marks=SLOW),
        pytest.param("overheat:servo=4,after=6", "Servo 4 (wrist_flex) shut down at 80 °C", marks=SLOW),
        pytest.param("undervoltage:volts=3.5,after=6", "needs 4.0 V", marks=SLOW),
        pytest.param("lost_packet:share=1,after=6", "answer", marks=SLOW),
    ],
)
def test_a_fault_ends_in_one_sentence_and_what_is_saved_is_kept(capfd, fault, words):
    assert record(*SO101, "--episodes", "12", "--fault", fault) == 2
    said = capfd.readouterr().err.splitlines()[-1]
    assert said.startswith("nas: ") and words in said
    kept = read(UNDER_WAY)
    assert 0 < kept.n_episodes < 12
    assert f"{kept.n_episodes} of 12 episodes are saved" in said


def test_a_killed_recorder_loses_nothing_that_was_saved_and_leaves_no_torque(bus, monkeypatch):
    monkeypatch.setattr(watchdog, "subprocess", subprocess)  # a guard of its own, as users have it
    bus, folder = bus
    known = driver(folder, bus.port)
    options = ["--robot.type", "so101_follower", "--robot.port", bus.port, "--robot.id", "test", "--episodes", "9"]
    options += [f"--robot.calibration_dir={folder}", "--excitation", "multisine:share=0.3"]
    recorder = multiprocessing.get_context("fork").Process(target=record, args=options)
    recorder.start()
    until = time.monotonic() + 60
    while not saved() and time.monotonic() < until:
        assert recorder.is_alive()
        time.sleep(0.02)
    promised = saved()
    os.kill(recorder.pid, signal.SIGKILL)
    recorder.join()
    assert saved() >= promised > 0
    assert wait_for_safety(known) == [0] * 6
    assert record(*options, "--finish") == 0
    assert verify(finished()) == []
    assert read(finished()).n_episodes >= promised


def saved() -> int:
    return read(UNDER_WAY).n_episodes if UNDER_WAY.exists() else 0


def wait_for_safety(known: LeRobotDriver) -> list[int]:
    """Return the torques once the guard has given the port back, or as they are after some seconds."""
    until, found = time.monotonic() + 5, [1]
    while sum(found) and time.monotonic() < until:
        time.sleep(0.2)
        with contextlib.suppress(errors.ArmError):
            found = torques(known)
    return found


# Resuming


def test_a_recording_is_resumed_with_the_same_arm_in_the_same_frame_only(capfd):
    begun = (
        *SO101,
        "--episodes",
        "9",
        "--zero",
        "gripper=0.2",
        "--effect",
        "backlash:joint=elbow_flex,half_width=0.03",
    )
    assert record(*begun, "--fault", "adapter_pulled:after=2") == 2
    kept = read(UNDER_WAY).n_episodes
    assert 0 < kept < 9
    capfd.readouterr()
    for options, words in (
        ((*begun, "--reverse", "shoulder_lift"), "another direction of a joint (--reverse)"),
        ((*begun[:-4], *begun[-2:]), "another zero of a joint (--zero)"),
        (begun[:-2], "another set of effects (--effect)"),
    ):
        assert record(*options) == 2
        said = capfd.readouterr().err.splitlines()[-1]
        assert f"{UNDER_WAY} was started with " in said and words in said and "or another --name." in said
        assert read(UNDER_WAY).n_episodes == kept
    assert record(*begun) == 0
    assert read(finished()).n_episodes == 9


# Refusals


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--robot.type", "so101_follower"), "give the arm's port, --robot.port PORT, or --port virtual"),
        (("--robot.type", "so99_follower", "--port", "virtual"), "no model of a so99_follower"),
        (("--robot.type", "so99_follower", "--model", "ergojr", "--port", "virtual"), "no robot 'so99_follower'"),
        (("--robot.type", "so100_follower", "--port", "virtual"), "--model MODEL.xml"),
        ((*SO101, "--model", "ergojr"), "has no actuated joint 'shoulder_pan'"),
        ((*SO101, "--reverse", "m9"), "no joint 'm9'"),
        ((*SO101, "--zero", "gripper=open"), "--zero gripper is 'open'"),
        ((*SO101, "--speed", "0"), "--speed is 0"),
        ((*SO101, "--speed", "inf"), "--speed is inf"),
        ((*SO101, "--rate", "1"), "jump by 2 rad between commands; give --rate 10 or more"),
        ((*SO101, "--zero", "shoulder_lift=90"), "range of 'shoulder_lift' lies outside the model's; check --zero"),
        ((*SO101, "--robot.colour=red"), "LeRobot does not take these options"),
        ((*SO101, "--effect", "backlash:joint=m9,half_width=0.03"), "names the joint 'm9'"),
        ((*SO101, "--fault", "unplugged:servo=12"), "names servo 12"),
        (
            ("--robot.type", "so101_follower", "--robot.id=nobody", "--robot.calibration_dir=.", "--port", "/dev/null"),
            "lerobot-calibrate --robot.type=so101_follower --robot.port=/dev/null --robot.id=nobody",
        ),
    ],
)
def test_bad_input_costs_one_sentence_and_writes_nothing(capfd, options, words):
    assert record(*options) == 2
    lines = capfd.readouterr().err.splitlines()
    assert len(lines) == 1
    assert words in lines[0]
    assert not Path("datasets").exists()


def test_servos_with_another_calibration_than_the_file_are_refused(bus):
    bus, folder = bus
    opened = driver(folder, bus.port).open()
    opened.bus.calibration["elbow_flex"].homing_offset = 7
    words = r"holds 451 for Homing_Offset, its calibration file says 7; .*lerobot-calibrate --robot.type=so101_follower"
    with pytest.raises(errors.OptionError, match=words):
        opened.check()
    opened.close()


def test_a_port_that_another_program_uses_is_refused(bus):
    bus, folder = bus
    opened = driver(folder, bus.port).open()
    with pytest.raises(errors.PortBusy, match="is used by another program"):
        driver(folder, bus.port).open()
    opened.close()


def test_an_arm_that_must_not_be_moved_is_refused_and_each_reason_named(folder):
    with virtual(folder) as bus:
        arm = driver(folder, bus.port).open()
        arm.check()
        for fault, kind, words in (
            ("bent:servo=1,radians=2.2", errors.OutsideLimits, "shoulder_pan is at 126°, outside -110 … 110°"),
            (
                "wrong_model:servo=5",
                errors.WrongModel,
                r"Servo 5 \(wrist_roll\) has model number 1190; a sts3215 has 777",
            ),
            ("unplugged:servo=6", errors.ServoSilent, "Servo 6 does not answer, 1, 2, 3, 4, 5 do"),
            ("duplicate_id:servo=4,identity=3", errors.DuplicateId, "Two servos have the ID 3"),
        ):
            bus.inject(fault)
            time.sleep(0.1)
            with pytest.raises(kind, match=words):
                arm.check()
        arm.close()


# Parts


def test_lerobots_other_options_are_passed_on():
    spelt = RecordLerobot.normalise_arguments(
        ["--robot.type=koch_follower", "--robot.use_degrees=false", "--robot.x", "3", "--seed"]
    )
    assert spelt == [
        "--robot.type=koch_follower",
        "--robot.option",
        "use_degrees=false",
        "--robot.option",
        "x=3",
        "--seed",
    ]


@pytest.mark.parametrize(("sign", "lowest"), [(None, 0), (-1, -(2**15)), (15, -(2**15) + 1), (10, -1023)])
def test_a_register_reads_back_what_is_written(sign, lowest):
    register = Register(42, 2, sign)
    for value in (lowest, 0, 1, 1000):
        assert register.decode(bytes([0, 0, *register.encode(value)]), 40) == value
    with pytest.raises(errors.ServoRefused):
        register.encode(2**16)


def test_registers_are_kept_from_the_episode_on_in_which_they_change():
    settings = Settings.of(None)
    for episode, gain in enumerate([16, 16, 20]):
        settings.record(episode, {"elbow": {"P": gain}})
    again = Settings.of({"registers": settings.to_json()})
    again.record(3, {"elbow": {"P": 20}})
    assert [entry["from_episode"] for entry in again.to_json()] == [0, 2]
    again.record(1, {"elbow": {"P": 9}})
    assert again.to_json()[-1] == {"from_episode": 1, "joints": {"elbow": {"P": 9}}}
