"""Endurance of recordings through LeRobot: fifty episodes, a hundred kills, two thousand faults, minutes each."""

import contextlib
import json
import multiprocessing
import os
import signal
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("lerobot")

from support.lerobot_arm_samples import arm_of, driver, torques

from nas_data import errors
from nas_data.cli import main
from nas_data.dataset.read import read
from nas_data.dataset.verify import verify
from nas_data.hardware.virtual_bus.process import VirtualBus
from nas_data.robots.base import find_robot

pytestmark = [pytest.mark.slow, pytest.mark.timeout(7200)]

FAULTS, KILLS, EPISODES = 2000, 100, 50
MORE_THAN_SAVED = 8 * KILLS  # episodes that are planned; a killed recorder saves two or three
PATIENCE = 600  # [s] that planning and the first episode may take on a busy machine
LATE = 0.001  # share of rows
UNDER_WAY = Path("datasets/rec/recording")
DISTURBED = ("lost_packet:share=0.02", "corrupted_packet:share=0.02", "latency:share=0.005")
LASTING = (
    "adapter_pulled:after={after}",
    "unplugged:servo={servo},after={after}",
    "overload:servo={servo},after={after}",
    "overheat:servo={servo},after={after}",
    "undervoltage:volts=3.5,after={after}",
    "lost_packet:share=1,after={after}",
    "duplicate_id:servo=5,identity={servo}",
    "wrong_model:servo={servo}",
    "no_sync_read",
)
OUT_OF_REACH = ("adapter_pulled", "unplugged", "lost_packet", "duplicate_id")  # a servo may be beyond any command then
LATE_ROWS = ("rows come at", "are missing before")  # in findings; a disturbed line waits for lost packets
LARGEST_STEP = 0.15  # [rad] of an arm in a period: commands go at 2 rad/s, and two may be lost in a row


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def record(folder: Path, port: str, *options: str) -> int:
    robot = ("--robot.type", "so101_follower", "--robot.port", port, "--robot.id", "test")
    short = ("--seconds", "0.4", "--excitation", "multisine:share=0.4")
    return main(["record", "lerobot", *robot, f"--robot.calibration_dir={folder}", *short, *options])


def saved() -> int:
    return read(UNDER_WAY).n_episodes if UNDER_WAY.exists() else 0


def test_fifty_episodes_at_50_hz_come_late_in_less_than_a_row_in_a_thousand(capsys):
    options = ["--robot.type", "so101_follower", "--port", "virtual", "--episodes", str(EPISODES), "--json"]
    assert main(["record", "lerobot", *options, "--name", "rec"]) == 0
    answer = json.loads(capsys.readouterr().out)
    print(f"{answer['late_share']:.4%} late of {answer['frames']}, longest step {answer['longest_step']:.4f} s")
    assert answer["late_share"] < LATE
    (root,) = Path("datasets/rec").glob("v1-*")
    assert verify(root) == []


def test_a_hundred_kills_lose_nothing_that_was_called_saved(folder):
    options = ["--episodes", str(MORE_THAN_SAVED), "--name", "rec"]
    promised, kept = 0, None
    with VirtualBus(replace(arm_of(folder), wire_delay=False, lockstep=True)) as bus, contextlib.ExitStack() as killed:
        rng, known = np.random.default_rng(0), driver(folder, bus.port)
        for _ in range(KILLS):
            recorder = multiprocessing.get_context("fork").Process(target=record, args=(folder, bus.port, *options))
            recorder.start()
            killed.callback(recorder.kill)  # a recorder that is left holds the bus open
            until = time.monotonic() + PATIENCE
            while saved() <= promised and time.monotonic() < until:
                assert recorder.is_alive()
                time.sleep(0.02)
            time.sleep(float(rng.uniform(0, 1)))
            promised = saved()
            os.kill(recorder.pid, signal.SIGKILL)
            recorder.join()
            assert saved() >= promised > 0
            whole = read(UNDER_WAY)
            if kept is not None:
                assert all(
                    np.array_equal(whole.columns[key][: kept.n_frames], kept.columns[key]) for key in kept.columns
                )
            kept, promised = whole, whole.n_episodes
            time.sleep(2.5)  # the guard takes the arm over, then gives it back
            assert torques(known) == [0] * 6
        assert record(folder, bus.port, *options, "--finish") == 0
    (root,) = Path("datasets/rec").glob("v1-*")
    assert verify(root) == []
    assert read(root).n_episodes >= promised


def check_stop(folder: Path, bus: VirtualBus, fault: str, said: list[str]) -> None:
    """Check that a recorder that was stopped said why in a sentence, and left no torque, or said that it could not."""
    assert said[-1].startswith("nas: "), fault
    assert "Traceback" not in "".join(said)
    if fault.startswith(OUT_OF_REACH) and "switch the supply off" in "".join(said):
        return
    bus.repair()
    time.sleep(0.1)
    try:
        assert sum(torques(driver(folder, bus.port))) == 0, fault
    except errors.ArmError:
        assert fault.startswith(OUT_OF_REACH), fault


def check_recording(root: Path, episodes: int) -> None:
    """Check that a recording moves as an arm does, and that `verify` finds nothing but the rows that came late."""
    dataset = read(root)
    assert not [finding for finding in verify(root) if not any(words in finding for words in LATE_ROWS)]
    assert dataset.n_episodes == episodes
    assert np.abs(dataset.next_states[:, :6] - dataset.states[:, :6]).max() < LARGEST_STEP


def test_two_thousand_faults_of_all_kinds_cost_no_recording_and_no_wrong_value(folder, capfd):
    """Lasting faults stop a recording, which is resumed each time; a fault is a stop or a disturbed packet."""
    rng, arm = np.random.default_rng(0), replace(arm_of(folder), wire_delay=False, lockstep=True)
    stops, disturbed, number = 0, 0, 0

    def attempt(*faults: str) -> bool:
        nonlocal stops, disturbed
        with VirtualBus(replace(arm, faults=(*DISTURBED, *faults))) as bus:
            code = record(folder, bus.port, "--episodes", "20", "--name", f"rec{number}")
            if code:
                check_stop(folder, bus, "".join(faults) or "none", capfd.readouterr().err.splitlines())
                stops += 1
            disturbed += bus.count_disturbed()
        with capfd.disabled():
            print(f"rec{number}: {stops} stops, {disturbed} disturbed packets", flush=True)
        return code == 0

    while stops + disturbed < FAULTS:
        for place in rng.permutation(len(LASTING)):
            fault = LASTING[place].format(servo=rng.integers(1, 5), after=round(float(rng.uniform(0.1, 5)), 2))
            if attempt(fault):
                break
        while not list(Path(f"datasets/rec{number}").glob("v1-*")):
            attempt()  # a line that is bad enough may stop it again
        (root,) = Path(f"datasets/rec{number}").glob("v1-*")
        check_recording(root, 20)
        number += 1
    assert stops > number * (len(LASTING) // 2)


def test_the_gap_names_what_the_virtual_arm_was_given(capsys):
    given = ["--effect", "backlash:joint=elbow_flex,half_width=0.03", "--blind", "--lockstep"]
    arm = ["--robot.type", "so101_follower", "--port", "virtual", "--episodes", "8", "--seconds", "4"]
    assert main(["record", "lerobot", *arm, *given, "--name", "rec"]) == 0
    model = str(find_robot("so101_follower").mjcf)
    assert main(["gap", "datasets/rec", "--model", model, "--out", "gap"]) == 0
    report = json.loads(Path("gap/report.json").read_text())
    (found,) = report["effects"]
    assert report["verdict"] == "explained"
    assert (found["effect"], found["joint"]) == ("backlash", "elbow_flex")
    assert found["parameters"]["half_width"]["value"] == pytest.approx(0.03, abs=0.002)
    assert found["confidence"] > 0.9
