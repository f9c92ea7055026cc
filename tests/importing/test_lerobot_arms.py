"""LeRobot datasets of arms as people have them: quiet episodes, grippers, further components, joints without suffix."""

from pathlib import Path

import numpy as np
import pytest
from support.command_samples import refused
from support.import_samples import columns_of, map_text, motion, write_log, write_map
from support.lerobot_samples import enter_with_arm, from_ticks, motions, write_calibration, write_lerobot

from nas_data.cli import main
from nas_data.dataset.features import STATE
from nas_data.dataset.read import read

pytest.importorskip("lerobot")
GRIPPER = """<mujoco><compiler angle="radian" autolimits="true"/><worldbody><body pos="0 0 0.5">
<joint name="j1" axis="0 1 0" range="-2 2"/><geom size="0.02" mass="0.1"/><body pos="0.1 0 0">
<joint name="gripper" type="slide" axis="0 1 0" range="0 0.04"/><geom size="0.01" mass="0.02"/></body></body>
</worldbody><actuator><position joint="j1" kp="2"/><position joint="gripper" kp="50"/></actuator></mujoco>"""
DEGREES = 180 / np.pi


@pytest.fixture
def here(tmp_path, monkeypatch) -> Path:
    return enter_with_arm(tmp_path, monkeypatch)


def in_degrees(*sizes: float) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return episodes in degrees, each multiplied by a number."""
    return [
        (size * states * DEGREES, size * commands * DEGREES)
        for size, (states, commands) in zip(sizes, motions(len(sizes)), strict=True)
    ]


def test_a_quiet_episode_is_in_the_unit_of_the_others(here, capsys):
    write_lerobot(here / "d", in_degrees(1, 0.02, 1))
    assert main(["import", "d", "--unit", "deg", "--out", "out"]) == 0
    assert "hardly have moved" not in capsys.readouterr().out
    write_lerobot(here / "quiet", in_degrees(0.02, 0.02))
    assert "if these are radians, use --unit rad" in refused("import", "quiet", "--unit", "deg", "--out", "no")


def test_a_quiet_log_beside_a_moving_one_is_a_warning_and_alone_an_error(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("logs").mkdir()
    for name, size in (("a", 1.0), ("b", 0.02)):
        columns = columns_of(motion())
        log = {key: values * (1 if key == "t" else size * DEGREES) for key, values in columns.items()}
        write_log(Path(f"logs/{name}.npz"), log)
    units = {"position": 'column = "q"\nunit = "deg"', "command": 'column = "goal"\nunit = "deg"'}
    write_map(tmp_path, map_text(velocity='"derive"', register='column = "dq"\nunit = "deg/s"', **units))
    assert main(["import", "logs", "--map", "map.toml", "--out", "out"]) == 0
    assert "b.npz" in (said := capsys.readouterr().out) and "hardly have moved" in said
    assert "hardly have moved" in refused("import", "logs/b.npz", "--map", "map.toml", "--out", "no")


def test_a_unit_that_the_map_does_not_leave_open_is_refused(here, capsys):
    write_lerobot(here / "d", motions())
    (here / "map.toml").write_text(
        'format = "lerobot"\nrobot = "arm2"\njoints = ["j1", "j2"]\nalignment = "action_follows_state"\n'
        'velocity = "derive"\n[read.position]\nunit = "rad"\n[read.command]\nunit = "rad"\n'
    )
    said = refused("import", "d", "--map", "map.toml", "--unit", "deg", "--out", "no")
    assert "no joint in degrees, which --unit would replace" in said


def test_the_remedy_for_jumps_works_for_an_arm_with_a_gripper_in_radians(here):
    wrapped = [((states + 3 + np.pi) % (2 * np.pi) - np.pi, commands + 3) for states, commands in motions()]
    write_lerobot(here / "d", wrapped, joints=("j1", "gripper"))
    assert main(["import", "d", "--unwrap", "--out", "out"]) == 0
    assert np.abs(np.diff(read(here / "out").states[:59, :2], axis=0)).max() < 1


def test_a_gripper_that_is_a_slide_in_the_model_is_read_in_metres(here, capsys):
    (here / "gripper.xml").write_text(GRIPPER)
    share = 50 + 40 * np.sin(np.arange(60) / 5)
    episodes = [(np.stack([states[:, 0] * DEGREES, share], 1),) * 2 for states, _ in motions()]
    write_lerobot(here / "d", episodes, joints=("j1", "gripper"))
    assert main(["import", "d", "--unit", "deg", "--model", "gripper.xml", "--out", "out"]) == 0
    assert "was read as" not in capsys.readouterr().out
    dataset = read(here / "out")
    assert dataset.slides == {"gripper"}
    (here / "wide.xml").write_text(GRIPPER.replace('type="slide"', "").replace("0 0.04", "0 1"))
    assert main(["import", "d", "--unit", "deg", "--model", "wide.xml", "--out", "wide"]) == 0
    assert "shares of its range" not in (said := capsys.readouterr().out) and "low and high exchanged" in said
    assert dataset.states[:59, 1] == pytest.approx(share[:-1] / 100 * 0.04, abs=1e-6)


def test_components_that_belong_to_no_joint_are_named(here, capsys):
    write_lerobot(here / "d", [(np.hstack([s, s[:, :1]]), np.hstack([c, c[:, :1]])) for s, c in in_degrees(1, 1)],
                  joints=("j1", "j2", "x"))  # fmt: skip
    (here / "map.toml").write_text(
        'format = "lerobot"\nrobot = "arm2"\njoints = ["j1", "j2"]\nalignment = "action_follows_state"\n'
        'velocity = "derive"\n[read.position]\nunit = "deg"\n[read.command]\nunit = "deg"\n'
    )
    assert main(["import", "d", "--map", "map.toml", "--out", "out"]) == 0
    assert "left out: x.pos of observation.state and x.pos of action" in capsys.readouterr().out


def test_bare_names_are_joint_names_when_datasets_are_joined_or_compared(here, capsys):
    for name, joints in (("a", ("j1", "j2")), ("b", ("j1", "other"))):
        write_lerobot(here / name, motions(), joints=joints)
        info = here / name / "meta/info.json"
        info.write_text(info.read_text().replace(".pos", ""))
    assert read(here / "a").features[STATE].names == ("j1", "j2")
    said = refused("merge", "a", "b", "--name", "no")
    assert "has the joints j1, other" in said and "without names" not in said
    assert main(["diff", "a", "b"]) in (0, 1)
    assert "other" in capsys.readouterr().out


def test_commands_that_are_logged_when_they_change_have_a_remedy_that_keeps_the_log(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    columns = columns_of(motion())
    columns["goal"][1:20] = np.nan
    write_log(Path("log.npz"), columns)
    write_map(tmp_path)
    said = refused("import", "log.npz", "--map", "map.toml", "--out", "no")
    assert "repeat the last one in these rows" in said


def test_each_arm_of_a_robot_has_its_calibration_file(here):
    ticks = np.stack([np.linspace(900, 3000, 40), np.linspace(2900, 1000, 40)], axis=1)
    motors = {side: write_calibration(here / f"me_{side}.json", ("j1",), turned=("j1",) if side == "left" else ())
              for side in ("left", "right")}  # fmt: skip
    stored = [from_ticks(ticks[:, [i]], motors[side]["j1"], "range") for i, side in enumerate(("left", "right"))]
    rows = np.hstack(stored)
    write_lerobot(here / "bi", [(rows, rows)] * 2, joints=("left_j1", "right_j1"))
    words = ("import", "bi", "--unit", "range", "--calibration", "me_left.json")
    assert "files of all arms of the robot: --calibration ID_left.json" in refused(*words, "--out", "no")
    (here / "you_left.json").write_bytes((here / "me_left.json").read_bytes())
    assert "of the side 'left'" in refused(*words, "--calibration", "you_left.json", "--out", "no")
    assert main([*words, "--calibration", "me_right.json", "--out", "out"]) == 0
    middle = [(motors[side]["j1"]["range_min"] + motors[side]["j1"]["range_max"]) / 2 for side in motors]
    expected = (ticks - middle) * 2 * np.pi / 4095
    assert read(here / "out").states[:39, :2] == pytest.approx(expected[:-1], abs=1e-4)
    assert (here / "out/meta/calibration_right.json").read_bytes() == (here / "me_right.json").read_bytes()


def test_a_gripper_that_spans_one_is_doubted(here, capsys):
    share = 0.5 + 0.49 * np.sin(np.arange(60) / 5)
    for name, values in (("d", share), ("e", 0.4 * share)):
        write_lerobot(
            here / name, [(np.stack([s[:, 0], values], 1),) * 2 for s, _ in motions()], joints=("j1", "gripper")
        )
        assert main(["import", name, "--unit", "rad", "--out", f"{name}o"]) == 0
        assert ("write unit = 'normalised', range = [0.0, 1.0]" in capsys.readouterr().out) == (name == "d")
