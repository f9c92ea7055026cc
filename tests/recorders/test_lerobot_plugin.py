"""The plug-in for LeRobot: found by name from its wheel, safe on a virtual arm, recorded into usable datasets."""

import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from support.xl320_samples import torques, virtual

from nas_data.cli import main
from nas_data.dataset.features import ACTION, NEXT_STATE, STATE
from nas_data.dataset.read import read
from nas_data.dataset.transitions import as_transitions
from nas_data.errors import NobodyAnswers, OptionError
from nas_data.hardware.xl320.arm import Xl320Arm
from nas_data.hardware.xl320.control_table import TICK
from nas_data.hardware.xl320.joints import default_path, make_ergojr_joints, read_calibration, write_calibration

pytest.importorskip("lerobot")
JOINTS = make_ergojr_joints()
PROJECT = Path(__file__).parents[2] / "lerobot_robot_ergojr"
REGISTERED = """
from lerobot.utils.import_utils import register_third_party_plugins
from lerobot.robots import RobotConfig
from lerobot.teleoperators import TeleoperatorConfig
register_third_party_plugins()
print(RobotConfig.get_choice_class("ergojr").__name__)
print(TeleoperatorConfig.get_choice_class("ergojr_excitation").__name__)
"""
RECORD = """
import sys
from lerobot.scripts.lerobot_record import main
main()
"""


@pytest.fixture(scope="module")
def installed(tmp_path_factory) -> dict[str, str]:
    """Unpack the plug-in's wheel as pip would; return the variables with which Python finds it."""
    wheels, site = tmp_path_factory.mktemp("wheels"), tmp_path_factory.mktemp("site")
    build = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation", "--no-index"]
    subprocess.run([*build, "--wheel-dir", str(wheels), str(PROJECT)], check=True, capture_output=True)
    (wheel,) = wheels.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(site)
    paths = [str(site), str(PROJECT.parent), os.environ.get("PYTHONPATH", "")]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(paths), "HF_HUB_OFFLINE": "1"}


@pytest.fixture
def plugin(monkeypatch, tmp_path):
    monkeypatch.syspath_prepend(str(PROJECT))
    import lerobot_robot_ergojr

    return lerobot_robot_ergojr


@pytest.fixture
def robot_on(plugin, tmp_path):
    """Return a function that makes a robot on a port; none is left connected."""
    robots = []

    def make(port: str):
        robots.append(plugin.ErgoJr(plugin.ErgoJrConfig(port=port, calibration_dir=tmp_path)))
        return robots[-1]

    yield make
    for robot in robots:
        robot.disconnect()


def test_lerobot_registers_robot_and_teleoperator_of_a_package_on_the_path(plugin):
    from lerobot.robots import RobotConfig
    from lerobot.teleoperators import TeleoperatorConfig
    from lerobot.utils.import_utils import register_third_party_plugins

    register_third_party_plugins()
    assert RobotConfig.get_choice_class("ergojr") is plugin.ErgoJrConfig
    assert TeleoperatorConfig.get_choice_class("ergojr_excitation") is plugin.ErgoJrExcitationConfig


@pytest.mark.slow
def test_lerobot_finds_robot_and_teleoperator_by_their_names(installed, tmp_path):
    run = subprocess.run(
        [sys.executable, "-c", REGISTERED], env=installed, cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert run.stdout.split() == ["ErgoJrConfig", "ErgoJrExcitationConfig"]


def test_the_robot_rises_slowly_moves_and_is_left_without_torque(robot_on, tmp_path):
    with virtual() as bus:
        robot = robot_on(bus.port)
        (tmp_path / "ergojr.json").write_text(calibration((0,) * 6))
        robot.connect()
        assert robot.is_connected
        seen = robot.get_observation()
        assert seen.keys() == robot.observation_features.keys()
        assert max(abs(seen[name]) for name in robot.action_features) < 0.2  # upright, but for friction and weight
        wanted = dict.fromkeys(robot.action_features, 0.3)
        for _ in range(60):
            sent = robot.send_action(wanted)
        assert sent == pytest.approx(wanted, abs=TICK / 2)
        assert robot.get_observation()["m1.pos"] == pytest.approx(0.3, abs=0.1)
        assert robot.send_action(dict.fromkeys(wanted, 9.0))["m1.pos"] == pytest.approx(np.pi / 2, abs=TICK)
        robot.disconnect()
        assert not robot.is_connected
        assert torques(bus.port) == [0] * 6


def calibration(offsets: tuple[int, ...]) -> str:
    entries = zip(JOINTS.names, JOINTS.ids, JOINTS.direct, offsets, strict=True)
    return json.dumps(
        {
            name: {"id": i, "drive_mode": int(not direct), "homing_offset": offset, "range_min": 0, "range_max": 1023}
            for name, i, direct, offset in entries
        }
    )


def test_the_torque_stays_off_until_the_first_action(robot_on):
    with virtual() as bus:
        robot = robot_on(bus.port)
        robot.connect(calibrate=False)
        robot.get_observation()
        assert [robot._guarded.arm.bus.get(identity, "torque_enable") for identity in JOINTS.ids] == [0] * 6
        robot.send_action(dict.fromkeys(robot.action_features, 0.0))
        assert [robot._guarded.arm.bus.get(identity, "torque_enable") for identity in JOINTS.ids] == [1] * 6


def test_a_person_calibrates_with_the_arm_held_upright(robot_on, monkeypatch):
    offsets = (3, -2, 1, 4, -3, 2)  # ticks by which the horns were mounted off their marks
    with virtual("zeroed", offsets=offsets) as bus:
        robot = robot_on(bus.port)
        assert not robot.is_calibrated
        monkeypatch.setattr("builtins.input", lambda text: text)
        robot.connect()
        stored = read_calibration(robot.calibration_fpath, JOINTS)
        assert robot.is_calibrated
        assert np.abs(stored.offsets).tolist() == np.abs(offsets).tolist()
        assert robot.calibration["m2"].homing_offset == stored.offsets[1]
        seen = robot.get_observation()
        assert max(abs(seen[name]) for name in robot.action_features) < 0.1


def test_an_arm_that_is_not_there_is_refused_and_nothing_stays_open(robot_on, tmp_path, monkeypatch):
    monkeypatch.setattr("nas_data.hardware.xl320.bus.LENIENCE", 0.002)  # no answer comes, however long one waits
    with virtual("lost_packet:share=1") as bus:
        (tmp_path / "ergojr.json").write_text(calibration((0,) * 6))
        robot = robot_on(bus.port)
        with pytest.raises(NobodyAnswers):
            robot.connect()
        assert not robot.is_connected
        Xl320Arm(bus.port, JOINTS).close()


def test_the_excitation_plays_whole_ticks_that_repeat_with_its_seed(plugin, monkeypatch):
    def played(seed: int) -> np.ndarray:
        teleoperator = plugin.ErgoJrExcitation(plugin.ErgoJrExcitationConfig(motions=2, seconds=0.5, seed=seed))
        teleoperator.connect()
        rows = []
        for step in range(600):
            monkeypatch.setattr("time.monotonic", lambda step=step: 5.0 + (step + 0.5 * (step > 0)) / 100)
            rows.append(list(teleoperator.get_action().values()))
        assert teleoperator.get_action().keys() == teleoperator.action_features.keys()
        return np.array(rows)

    rows = played(0)
    assert rows / TICK == pytest.approx(np.rint(rows / TICK), abs=1e-9)
    assert np.array_equal(rows, played(0))
    assert not np.array_equal(rows, played(1))
    assert np.array_equal(rows[:50], rows[500:550])  # two motions of half a second, two rests of two seconds
    assert not rows[50:250].any()


def test_an_unknown_signal_is_refused(plugin):
    with pytest.raises((OptionError, LookupError), match="dance"):
        plugin.ErgoJrExcitation(plugin.ErgoJrExcitationConfig(excitation="dance")).connect()


@pytest.mark.slow
def test_lerobot_record_writes_a_dataset_that_is_taken_as_it_is(installed, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    options = {
        "robot.type": "ergojr",
        "robot.port": "virtual",
        "teleop.type": "ergojr_excitation",
        "teleop.excitation": "sine:share=0.3",
        "teleop.motions": "2",
        "dataset.repo_id": "nas/rec",
        "dataset.root": "lerobot_rec",
        "dataset.single_task": "sine",
        "dataset.fps": "50",
        "dataset.num_episodes": "2",
        "dataset.episode_time_s": "1",
        "dataset.reset_time_s": "0.5",
        "dataset.push_to_hub": "false",
        "dataset.video": "false",
        "play_sounds": "false",
    }
    arguments = [f"--{key}={value}" for key, value in options.items()]
    environment = {**installed, "HF_LEROBOT_HOME": str(tmp_path / "home")}
    run = subprocess.run(
        [sys.executable, "-c", RECORD, *arguments], env=environment, capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr
    root = Path("lerobot_rec")
    dataset = read(root)
    assert dataset.n_episodes == 2
    assert dataset.robot_type == "ergojr"
    complete, derived = as_transitions(dataset)
    assert complete.joints == JOINTS.names
    assert list(derived) == [STATE, ACTION, NEXT_STATE]
    assert np.ptp(complete.states[:, :6], axis=0).max() > 0.1
    assert complete.commands / TICK == pytest.approx(np.rint(complete.commands / TICK), abs=1e-3)
    assert main(["info", str(root)]) == 0
    assert "derived when used: next.observation.state" in capsys.readouterr().out
    assert main(["import", str(root), "--name", "imported"]) == 0
    assert read(Path("datasets/imported")).n_frames == complete.n_frames
    assert main(["pair", str(root), "--model", "ergojr"]) == 0
    assert read(Path("datasets/lerobot_rec")).sim_states.shape == complete.states.shape


# Calibration


def test_a_calibration_is_read_as_lerobot_reads_it(tmp_path):
    from lerobot.motors.motors_bus import MotorCalibration

    path = tmp_path / "deep" / "arm.json"
    joints = JOINTS.with_offsets((3, -4, 0, 12, 1, -9))
    write_calibration(path, joints)
    content = json.loads(path.read_text())
    entries = {name: MotorCalibration(**entry) for name, entry in content.items()}
    assert [entry.homing_offset for entry in entries.values()] == [3, -4, 0, 12, 1, -9]
    assert [entry.drive_mode for entry in entries.values()] == [0, 1, 1, 0, 1, 1]
    assert all(0 <= entry.range_min < entry.range_max <= 1023 for entry in entries.values())
    assert read_calibration(path, JOINTS) == joints


def test_the_calibration_lies_where_lerobot_looks_for_it(monkeypatch, tmp_path):
    from lerobot.utils import constants

    for name in ("HF_LEROBOT_CALIBRATION", "HF_LEROBOT_HOME", "HF_HOME"):
        monkeypatch.delenv(name, raising=False)
    assert default_path("ergojr", "mine") == constants.HF_LEROBOT_CALIBRATION / "robots" / "ergojr" / "mine.json"
    monkeypatch.setenv("HF_LEROBOT_CALIBRATION", str(tmp_path))
    assert default_path("ergojr", "mine") == tmp_path / "robots" / "ergojr" / "mine.json"
