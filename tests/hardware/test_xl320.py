"""The driver moves a virtual arm through unmodified dynamixel-sdk, and says in a sentence what is wrong with it."""

import json
import os
import subprocess
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.xl320_samples import be_patient, connected, torques, virtual

from nas_data import errors
from nas_data.cli import main
from nas_data.hardware.arms.line import LENIENCE
from nas_data.hardware.virtual_bus import process
from nas_data.hardware.virtual_bus.faults import list_faults, parse
from nas_data.hardware.virtual_bus.process import VirtualBus
from nas_data.hardware.virtual_bus.terminal import Options
from nas_data.hardware.xl320.arm import Configuration, Reading, Xl320Arm
from nas_data.hardware.xl320.control_table import (
    CENTRE,
    REGISTERS,
    SPEED_UNIT,
    TICK,
    decode_sign_magnitude,
    encode_sign_magnitude,
)
from nas_data.hardware.xl320.joints import default_path, make_ergojr_joints, read_calibration, write_calibration

JOINTS = make_ergojr_joints()
BOUND = 75 * LENIENCE  # [s] most time that waiting for replies may take
FAST = Configuration(speed=0.0)


# Units


@given(st.integers(-1023, 1023))
def test_sign_magnitude_goes_there_and_back(value):
    assert decode_sign_magnitude(np.array(encode_sign_magnitude(value))) == value


def test_units_are_the_manuals():
    assert pytest.approx(0.293, abs=5e-4) == np.degrees(TICK)
    assert pytest.approx(0.666, abs=5e-4) == np.degrees(SPEED_UNIT)
    assert decode_sign_magnitude(np.array([0, 1023, 1024, 1025, 2047])).tolist() == [0, 1023, 0, -1, -1023]


@given(st.lists(st.integers(220, 800), min_size=6, max_size=6), st.lists(st.integers(-60, 60), min_size=6, max_size=6))
def test_ticks_and_radians_are_inverse_of_each_other(raw, offsets):
    joints = JOINTS.with_offsets(tuple(offsets))
    assert joints.raw(joints.positions(np.array(raw))).tolist() == raw


def test_indirect_joints_turn_against_their_servos():
    raw = np.full(6, CENTRE + 100)
    assert np.sign(JOINTS.positions(raw)).tolist() == [1, -1, -1, 1, -1, -1]
    assert np.sign(JOINTS.velocities(np.full(6, 5))).tolist() == [1, -1, -1, 1, -1, -1]
    assert np.sign(JOINTS.loads(np.full(6, 1024 + 5))).tolist() == [-1, 1, 1, -1, 1, 1]


@given(st.lists(st.floats(-10, 10), min_size=6, max_size=6))
def test_goals_stay_within_the_limits(positions):
    reached = JOINTS.positions(JOINTS.ticks(np.array(positions)))
    assert (reached >= np.array(JOINTS.low) - TICK / 2 - 1e-9).all()
    assert (reached <= np.array(JOINTS.high) + TICK / 2 + 1e-9).all()


# A sound arm


def test_a_virtual_arm_is_a_process_of_its_own_that_ends_with_its_input(monkeypatch):
    """Started as users start it; other tests fork theirs."""
    monkeypatch.setattr(process, "subprocess", subprocess)
    with virtual() as bus:
        assert os.getsid(bus._process.pid) == bus._process.pid, "Ctrl-C in the terminal must not end it"
        assert torques(bus.port) == [0] * 6
    assert bus._process.returncode == 0


def drive(arm: Xl320Arm, target: np.ndarray, periods: int) -> Reading:
    """Command a pose for some periods; each is over when the arm has answered."""
    for _ in range(periods):
        arm.command(target)
        reading = arm.read()
    return reading


@pytest.fixture(scope="module")
def arm():
    with connected() as arm:
        arm.check()
        arm.configure(FAST)
        yield arm


@pytest.fixture(scope="module")
def bus() -> Iterator[VirtualBus]:
    """Return a sound arm that each test leaves sound, and to which no driver is connected."""
    with virtual() as bus:
        yield bus


def test_the_arm_is_found_and_set_up(arm):
    found = arm.check()
    assert [servo.id for servo in found] == [1, 2, 3, 4, 5, 6]
    assert {servo.model for servo in found} == {350}
    assert not arm.sequential
    assert arm.bus.get(3, "return_delay") == 0
    assert arm.bus.get(3, "status_level") == 2
    assert arm.bus.get(3, "moving_speed") == 0
    assert arm.describe()["configuration"]["registers"]["p_gain"] == 32


def test_a_configuration_is_written_as_it_says(arm):
    chosen = Configuration(p_gain=20, i_gain=3, d_gain=1, speed=1.0, torque=0.5)
    arm.configure(chosen)
    written = {name: arm.bus.get(2, name) for name in chosen.registers()}
    assert written == {"p_gain": 20, "i_gain": 3, "d_gain": 1, "moving_speed": 86, "torque_limit": 512}
    arm.configure(FAST)


def test_a_locked_register_is_refused_in_a_sentence(arm):
    arm.bus.write(2, "torque_enable", 1)
    with pytest.raises(errors.ServoRefused, match=r"Servo 2 refuses 9 for return delay: .* locked while the torque"):
        arm.bus.write(2, "return_delay", 9)
    arm.torque_off()


def test_the_arm_does_not_jump_when_the_torque_comes_on(arm):
    before = arm.read().positions
    arm.torque_on()
    assert np.abs(drive(arm, before, 20).positions - before).max() < 0.1


def test_the_arm_goes_where_it_is_told_to(arm):
    arm.torque_on()
    target = np.array([0.5, -0.3, 0.4, -0.5, 0.3, 0.2])
    assert arm.command(target) == pytest.approx(target, abs=TICK / 2)
    reading = drive(arm, target, 150)
    assert np.abs(reading.positions - target).max() < 0.2  # friction and weight keep it from the goal
    assert np.abs(reading.velocities).max() < 0.1
    assert len(reading.raw) == 36
    assert reading.alerts == ()


def test_readings_are_the_registers(arm):
    reading = arm.read()
    raw = np.array([arm.bus.get(identity, "present_position") for identity in JOINTS.ids])
    assert reading.positions == pytest.approx(JOINTS.positions(raw))
    arm.sequential = True
    assert arm.read().raw == reading.raw
    arm.sequential = False


def test_commands_beyond_the_limits_are_cut(arm):
    assert arm.command(np.full(6, 9.0)) == pytest.approx(np.array(JOINTS.high), abs=TICK / 2)
    assert arm.bus.get(1, "goal_position") == JOINTS.raw(np.array(JOINTS.high))[0]


def test_the_speed_limit_is_kept():
    with connected() as arm:
        arm.configure(Configuration(speed=0.5))
        arm.torque_on()
        target = np.array([1.5, -1.31, 0.72, 0, 0.9, 0])
        before, after = drive(arm, target, 50), drive(arm, target, 50)  # it has started to move in the first
        assert after.positions[0] - before.positions[0] == pytest.approx(0.25, abs=0.03)


def test_an_effect_of_the_virtual_arm_is_felt():
    reached = []
    for effects in ((), ("servo_stiffness:joint=m1,factor=0.3",)):
        with connected(effects=effects) as arm:
            arm.configure(FAST)
            arm.torque_on()
            reached.append(drive(arm, np.array([1.0, -1.31, 0.72, -0.15, 0.94, 0.28]), 12).positions[0])
    assert reached[0] > reached[1] + 0.05


def test_leaving_the_arm_switches_the_torque_off(bus):
    with Xl320Arm(bus.port, JOINTS) as arm:
        arm.configure(FAST)
        arm.torque_on()
        arm.command(np.zeros(6))
    assert torques(bus.port) == [0] * 6


def test_an_honest_line_takes_its_time_and_less_of_it_once_the_arm_is_set_up(monkeypatch):
    """Of many readings the fastest counts: a busy machine adds to the others."""
    be_patient(monkeypatch)
    wire = 6 * 17 * 10e-6  # [s] of six replies
    factory = wire + 6 * 500e-6  # [s] with the pause that a servo makes before its reply
    with VirtualBus(Options(wire_delay=True)) as bus, Xl320Arm(bus.port, JOINTS) as arm:

        def reading() -> float:
            began = time.monotonic()
            assert arm.bus.sync_read(JOINTS.ids, 37, 6) is not None
            return time.monotonic() - began

        assert min(reading() for _ in range(20)) >= factory
        arm.configure(FAST)
        assert wire <= min(reading() for _ in range(200)) < factory


def test_servos_without_sync_read_are_read_one_by_one():
    with connected("no_sync_read") as arm:
        arm.check()
        assert arm.sequential
        assert arm.read().positions.shape == (6,)
        assert arm.describe()["sequential_reads"]


# Refusals


@pytest.mark.parametrize(
    ("fault", "error", "words"),
    [
        ("unplugged:servo=3", errors.ServoSilent, "Servo 3 does not answer, 1, 2, 4, 5, 6 do; check its plug"),
        ("wrong_model:servo=5", errors.WrongModel, "Servo 5 has model number 1190; an XL-320 has 350"),
        ("duplicate_id", errors.DuplicateId, "Two servos have the ID 3; unplug all but one"),
        ("duplicate_id:return_delay=0", errors.DuplicateId, "Two servos have the ID 3; unplug all but one"),
        ("undervoltage:volts=5.4", errors.SupplyLow, "gets 5.4 V; an XL-320 needs 6 V"),
        ("overload:servo=4", errors.ServoOverloaded, r"Servo 4 \(m4\) shut down by overload; remove the obstacle"),
        ("overheat:servo=6", errors.ServoHot, r"Servo 6 \(m6\) shut down at 80 °C; let it cool"),
        ("bent:servo=1,radians=1.9", errors.OutsideLimits, "m1 is at 109°, outside -90 … 90°; move it there"),
        ("lost_packet:share=1", errors.NobodyAnswers, "No servo answers on .*; switch the supply on"),
    ],
)
def test_an_arm_that_cannot_be_used_is_refused_in_one_sentence(fault, error, words):
    with virtual(fault) as bus:
        arm = Xl320Arm(bus.port, JOINTS)
        began = time.monotonic()
        with pytest.raises(error, match=words):
            arm.check()
        assert time.monotonic() - began < BOUND
        arm.close()


def test_an_adapter_that_is_pulled_is_told():
    with virtual() as bus:
        arm = Xl320Arm(bus.port, JOINTS)
        bus.inject("adapter_pulled")
        with pytest.raises(errors.AdapterLost, match="vanished while it was used; plug the adapter in"):
            arm.check()
        arm.close()


@pytest.mark.parametrize(
    ("fault", "error"),
    [
        ("unplugged:servo=3", errors.ServoSilent),
        ("lost_packet:share=1", errors.NobodyAnswers),
        ("adapter_pulled", errors.AdapterLost),
        pytest.param("corrupted_packet:share=1", errors.ArmError, marks=pytest.mark.slow),
    ],
)
def test_a_fault_in_motion_is_told_at_once(fault, error):
    with virtual() as bus:
        arm = Xl320Arm(bus.port, JOINTS)
        arm.configure(FAST)
        arm.torque_on()
        arm.command(np.zeros(6))
        bus.inject(fault)
        began = time.monotonic()
        with pytest.raises(error):
            for _ in range(100):
                arm.command(np.zeros(6))
                arm.read()
        said = arm.make_safe()
        assert time.monotonic() - began < BOUND
        assert bool(said)
        arm.close()


@pytest.mark.parametrize(
    ("fault", "error"),
    [
        ("overload:servo=2", errors.ServoOverloaded),
        ("overheat:servo=2", errors.ServoHot),
        ("undervoltage:volts=5.5", errors.SupplyLow),
    ],
)
def test_a_servo_that_shuts_down_raises_an_alert(fault, error):
    with virtual() as bus:
        arm = Xl320Arm(bus.port, JOINTS)
        arm.configure(FAST)
        arm.torque_on()
        bus.inject(fault)
        with pytest.raises(error):
            for _ in range(100):
                arm.command(np.zeros(6))
                arm.refuse_alerts(arm.read())
        assert arm.make_safe() == ""
        assert [arm.bus.get(identity, "torque_enable") for identity in JOINTS.ids] == [0] * 6
        arm.close()


@pytest.mark.parametrize(
    "fault",
    [
        pytest.param("lost_packet:share=0.1", marks=pytest.mark.slow),
        "corrupted_packet:share=0.1",
        pytest.param("latency:share=0.1", marks=pytest.mark.slow),
    ],
)
def test_no_reading_is_wrong_or_old_on_a_bad_line(fault):
    with virtual(fault) as bus:
        arm = Xl320Arm(bus.port, JOINTS)
        truth, position, still = {}, 0, None
        for step in range(30):
            identity = step % 6 + 1
            position = (position + 37) % 1024
            try:
                arm.bus.write(identity, "goal_position", position)
                truth[identity] = position
                assert arm.bus.get(identity, "goal_position") == truth[identity]
                reading = arm.read()
            except (errors.ServoSilent, errors.BadReply, errors.NobodyAnswers, errors.ServoRefused):
                continue
            still = still or reading.raw  # the torque is off, and no time passes
            assert reading.raw == still
        assert arm.bus.failures > 0
        assert len(truth) == 6
        arm.close()


def test_an_old_reply_is_not_taken_for_a_new_one(arm):
    late = arm.bus.sync_read(JOINTS.ids, REGISTERS["goal_position"].address, 6)
    assert late is not None
    arm.bus._handler.syncReadTx(
        arm.bus.port, 0, 6 + arm.bus._extra, list(JOINTS.ids), 6, False
    )  # nobody waits for this answer
    time.sleep(0.05)
    arm.bus.failures += 1
    heard, arm.bus.port.drain = arm.bus.port.drain, lambda: None  # as if it came after the line was cleared
    try:
        again = arm.bus.sync_read(JOINTS.ids, REGISTERS["goal_position"].address, 6)
    finally:
        arm.bus.port.drain = heard
    assert again == late


# Ports


def test_a_port_that_does_not_exist_is_named():
    with pytest.raises(errors.NoSuchPort, match="There is no port /dev/nowhere; plug the adapter in"):
        Xl320Arm("/dev/nowhere", JOINTS)


def test_a_file_is_no_port(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(errors.ArmError, match="cannot be used as a serial port"):
        Xl320Arm(str(tmp_path / "file"), JOINTS)


def test_a_port_in_use_is_busy(arm):
    with pytest.raises(errors.PortBusy, match="is used by another program; close"):
        Xl320Arm(arm.port, JOINTS)


@pytest.mark.parametrize(("code", "error"), [(13, errors.PortDenied), (16, errors.PortBusy), (6, errors.NoSuchPort)])
def test_what_the_system_refuses_has_a_name(monkeypatch, code, error):
    def refuse(*_: object, **__: object) -> None:
        raise OSError(code, os.strerror(code))

    monkeypatch.setattr("nas_data.hardware.xl320.bus.serial.Serial", refuse)
    with pytest.raises(error):
        Xl320Arm("/dev/null", JOINTS)


def test_a_silent_port_is_told_from_a_silent_servo():
    master, slave = os.openpty()
    arm = Xl320Arm(os.ttyname(slave), JOINTS)
    with pytest.raises(errors.NobodyAnswers):
        arm.check()
    arm.close()
    os.close(master)
    os.close(slave)


# Calibration


@pytest.mark.parametrize("change", [{"id": 7}, {"drive_mode": 1}, None])
def test_a_calibration_of_another_arm_is_refused(tmp_path, change):
    path = tmp_path / "arm.json"
    write_calibration(path, JOINTS)
    content = json.loads(path.read_text())
    content["m1"] = content["m1"] | change if change else {}
    path.write_text(json.dumps(content))
    with pytest.raises(errors.OptionError, match="calibra"):
        read_calibration(path, JOINTS)


# The command


def run(capsys, *options: str) -> tuple[int, str, str]:
    code = main(["robot", "ergojr", *options])
    output = capsys.readouterr()
    return code, output.out, output.err


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HF_LEROBOT_CALIBRATION", str(tmp_path / "calibration"))
    return tmp_path


def test_the_command_shows_what_is_found(bus, folder, capsys, monkeypatch):
    be_patient(monkeypatch)
    code, out, _ = run(capsys, "--port", bus.port, "--json")
    answer = json.loads(out)
    assert code == 0
    assert [servo["id"] for servo in answer["servos"]] == [1, 2, 3, 4, 5, 6]
    assert answer["problems"] == []


def test_the_command_says_what_is_wrong_and_still_shows_the_rest(folder, capsys):
    code, out, _ = run(capsys, "--port", "virtual", "--fault", "unplugged:servo=3", "--fault", "overload:servo=2")
    assert code == 1
    assert "problem: Servo 3 (m3) does not answer" in out
    assert "problem: Servo 2 (m2) shut down by overload" in out
    assert len([line for line in out.splitlines() if line.startswith("m")]) == 5


def test_the_command_clears_an_overload(folder, capsys):
    code, out, _ = run(capsys, "--port", "virtual", "--fault", "overload:servo=2", "--reboot")
    assert code == 0
    assert "ready" in out


def test_zeros_are_stored_and_used(folder, capsys):
    with virtual(offsets=(10, -7, 0, 4, 25, -3)) as bus:
        bus.inject("zeroed")
        assert run(capsys, "--port", bus.port, "--calibrate", "--id", "mine")[0] == 0
        path = folder / "calibration" / "robots" / "ergojr" / "mine.json"
        joints = read_calibration(path, JOINTS)
        assert joints.offsets == (-10, 7, 0, -4, -25, 3)
        with Xl320Arm(bus.port, joints) as arm:
            assert np.abs(arm.read().positions).max() < TICK


def test_a_pose_far_from_zero_is_no_calibration(folder, capsys):
    code, _, err = run(capsys, "--port", "virtual", "--calibrate", "--calibration", "zeros.json")
    assert code == 2
    assert "put the arm into its zero pose" in err
    assert not any(folder.iterdir())


def test_a_virtual_arm_leaves_the_zeros_of_a_real_one_alone(folder, capsys):
    path = default_path("ergojr", "ergojr")
    path.parent.mkdir(parents=True)
    write_calibration(path, make_ergojr_joints((50,) * 6))
    before = path.read_bytes()
    code, _, err = run(capsys, "--port", "virtual", "--fault", "zeroed", "--calibrate")
    assert code == 2
    assert "give another file for them: --calibration FILE" in err
    assert "Zeros: not calibrated" in run(capsys, "--port", "virtual")[1]
    assert path.read_bytes() == before


def test_a_servo_gets_another_identity(bus, folder, capsys):
    code, out, _ = run(capsys, "--port", bus.port, "--rename", "6:9")
    assert code == 1
    assert "Servo 9 is not a servo of this arm" in out
    assert run(capsys, "--port", bus.port, "--rename", "9:6")[0] == 0
    assert "ID 5 already answers" in run(capsys, "--port", bus.port, "--rename", "6:5")[2]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--port", "/dev/nowhere"), "There is no port /dev/nowhere"),
        (("--port", "/dev/nowhere", "--fault", "overload"), "belong to --port virtual"),
        (("--port", "virtual", "--fault", "gremlins"), "There is no fault 'gremlins'"),
        (("--port", "virtual", "--fault", "overload:when=2"), "overload has no parameter 'when'"),
        (("--port", "virtual", "--fault", "overload:servo=two"), "is not a fault"),
        (("--port", "virtual", "--effect", "gremlins"), "gremlins"),
        (("--port", "virtual", "--effect", "backlash:joint=m9,half_width=0.03"), "names the joint 'm9'"),
        (("--port", "virtual", "--effect", "object_mass:factor=2"), "needs a pushed object"),
        (("--port", "virtual", "--fault", "unplugged:servo=12"), "names servo 12; the virtual arm has: 1, 2"),
        (("--port", "virtual", "--fault", "overload:servo=3,after=2", "--fault", "unplugged"), "has: 1, 2, 4, 5, 6"),
        (("--port", "virtual", "--fault", "bent:servo=0"), "bends servo 0; the virtual arm has 1 to 6"),
        (("--port", "virtual", "--fault", "duplicate_id:identity=300"), "id is 300; it must lie in 0 … 255"),
        (("--port", "virtual", "--calibration", "absent.json"), "absent.json is not a calibration of this arm"),
        (("--port", "virtual", "--rename", "six:seven"), "write OLD:NEW"),
        (("--port", "virtual", "--calibration", __file__), "is not a calibration of this arm"),
    ],
)
def test_bad_input_costs_one_sentence(folder, capfd, options, words):
    assert main(["robot", "ergojr", *options]) == 2
    lines = capfd.readouterr().err.splitlines()
    assert len(lines) == 1
    assert words in lines[0]


# Faults


@pytest.mark.parametrize("name", list_faults())
def test_each_fault_says_what_it_is(name):
    fault = parse(name)
    assert type(fault) is list_faults()[name]
    assert replace(fault, after=2.0) == parse(f"{name}:after=2")
    assert fault.__doc__


def test_the_virtual_bus_counts_the_packets_that_its_faults_disturb():
    with VirtualBus(Options(wire_delay=False)) as bus, Xl320Arm(bus.port, JOINTS) as arm:
        arm.read()
        bus.inject("latency:share=1,seconds=0.001")
        assert bus.count_disturbed() == 0  # answered after the fault was taken
        for _ in range(3):
            arm.read()
        assert bus.count_disturbed() >= 3
