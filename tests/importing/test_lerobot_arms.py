"""LeRobot datasets of arms as people have them: quiet episodes, grippers, further components, joints without suffix."""

from pathlib import Path

import numpy as np
import pytest
from support.command_samples import refused
from support.import_samples import columns_of, map_text, motion, write_log, write_map
from support.lerobot_samples import (
    RADIANS,
    add_vector,
    enter_with_arm,
    from_ticks,
    motions,
    write_calibration,
    write_lerobot,
)

from nas_data.cli import main
from nas_data.dataset.features import STATE
from nas_data.dataset.provenance import read_provenance
from nas_data.dataset.read import read
from nas_data.dataset.verify import verify

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


FORCE = "observation.force"
FORCES = np.arange(180.0).reshape(60, 3) + 0.5


def write_forces(root: Path, names: str = "xyz", **details: str) -> Path:
    """Write an episode of an arm with a sensor whose components have some names; values are those of x, y, z."""
    order = ["xyz".index(name) for name in names]
    return add_vector(
        write_lerobot(root, motions(1)), FORCE, FORCES[:, order], [f"f{name}" for name in names], **details
    )


def test_vectors_of_several_datasets_are_joined_by_the_names_of_their_components(here):
    (here / "map.toml").write_text(RADIANS)
    write_forces(here / "a")
    write_forces(here / "b", "zyx", dtype="float64")
    for number, order in enumerate((("a", "b"), ("b", "a"))):
        assert main(["import", *order, "--map", "map.toml", "--out", f"out{number}"]) == 0
        dataset = read(here / f"out{number}")
        feature = dataset.features[FORCE]
        assert feature.names == (("fx", "fy", "fz"), ("fz", "fy", "fx"))[number] and feature.dtype == "float64"
        x = dataset.columns[FORCE][:, feature.names.index("fx")]
        np.testing.assert_array_equal(x, np.tile(FORCES[:59, 0], 2))


def test_numbers_of_several_datasets_are_joined_in_a_type_that_holds_both(here):
    (here / "map.toml").write_text(RADIANS)
    write_forces(here / "whole", dtype="int64")
    write_forces(here / "broken")
    assert main(["import", "whole", "broken", "--map", "map.toml", "--out", "out"]) == 0
    column = read(here / "out").columns[FORCE]
    np.testing.assert_array_equal(column[[0, 59]], [np.floor(FORCES[0]), FORCES[0]])


@pytest.mark.parametrize(
    ("names", "unit", "said"),
    [
        ("xyz", "mN", "has units N in a and mN in b"),
        ("xyz", "", "has units N in a and not stored in b"),
        ("xy", "N", "has names fx, fy, fz in a and fx, fy in b"),
    ],
)
def test_vectors_that_mean_different_things_are_refused_and_one_dataset_alone_is_not(here, names, unit, said):
    (here / "map.toml").write_text(RADIANS)
    write_forces(here / "a", unit="N")
    write_forces(here / "b", names, unit=unit)
    sentence = refused("import", "a", "b", "--map", "map.toml", "--out", "no")
    assert f"'{FORCE}' {said}; import them one at a time, or leave it out with LeRobot's" in sentence
    assert main(["import", "b", "--map", "map.toml", "--out", "out"]) == 0


@pytest.mark.parametrize("order", [("a", "bare"), ("bare", "a")])
def test_a_vector_that_not_every_dataset_has_is_left_out_and_named(here, capsys, order):
    (here / "map.toml").write_text(RADIANS)
    write_forces(here / "a")
    write_lerobot(here / "bare", motions(1))
    assert main(["import", *order, "--map", "map.toml", "--out", "out"]) == 0
    assert f"left out: '{FORCE}' (float32 of shape [3]), because not every dataset has them" in capsys.readouterr().out
    assert FORCE not in read(here / "out").features
    assert "left out" in read_provenance(here / "out").notes


def test_components_that_a_signal_does_not_pick_are_named(here, capsys):
    (here / "map.toml").write_text(f'{RADIANS}[signals.force]\ncolumn = "{FORCE}"\ncomponents = [0, 1]\nunit = "N"\n')
    write_forces(here / "a")
    assert main(["import", "a", "--map", "map.toml", "--out", "out"]) == 0
    assert f"left out: fz of {FORCE}, because the map reads no such component" in capsys.readouterr().out
    write_forces(here / "b", "zyx")
    said = refused("import", "a", "b", "--map", "map.toml", "--out", "no")
    assert f"'{FORCE}' has names fx, fy in a and fz, fy in b, but [signals.force] reads both alike" in said


def test_a_signal_of_the_joints_is_read_in_their_order(here):
    (here / "map.toml").write_text(f'{RADIANS}[signals.load]\ncolumn = "observation.load"\nunit = "1"\n')
    loads = np.stack([np.full(60, 2.0), np.full(60, 1.0)], 1)
    add_vector(write_lerobot(here / "d", motions(1)), "observation.load", loads, ["j2.load", "j1.load"])
    assert main(["import", "d", "--map", "map.toml", "--out", "out"]) == 0
    np.testing.assert_array_equal(read(here / "out").columns["nas.load"][0], [1.0, 2.0])


def write_velocities(root: Path, factor: float = 1.0, in_unit: float = 1.0) -> np.ndarray:
    """Write an episode whose states hold velocities, late by a row and times a factor; return them in SI."""
    ((states, commands),) = motions(1, 120)
    exact = np.gradient(states, 0.02, axis=0)
    late = np.vstack([exact[:1], exact[:-1]]) * factor
    vectors = np.hstack([states, late]) * in_unit, np.hstack([commands, 0 * commands]) * in_unit
    write_lerobot(root, [vectors], joints=("j1", "j2", "j1 speed", "j2 speed"))
    info = root / "meta/info.json"
    info.write_text(info.read_text().replace(" speed.pos", ".vel"))
    return late


@pytest.mark.parametrize(("unit", "in_unit"), [("rad", 1.0), ("deg", DEGREES)])
def test_velocities_that_the_states_hold_are_read_without_a_map(here, capsys, unit, in_unit):
    late = write_velocities(here / "d", in_unit=in_unit)
    assert main(["import", "d", "--unit", unit, "--out", "out"]) == 0
    dataset = read(here / "out")
    np.testing.assert_allclose(dataset.states[:, 2:], late[:-1], atol=1e-5)
    assert "nas.velocity" not in dataset.features and verify(here / "out") == []
    assert "velocities" not in read_provenance(here / "out").derived.get(STATE, "")
    assert "left out: j1.vel, j2.vel of action, because the map reads no such component" in capsys.readouterr().out


def test_velocities_in_minus_100_to_100_have_the_scale_of_the_positions(here):
    motors = write_calibration(here / "cal.json", ("j1", "j2"), turned=("j2",))
    factors = [
        (-1 if motor["drive_mode"] else 1) * 4095 / 360 * 200 / (motor["range_max"] - motor["range_min"]) * DEGREES
        for motor in motors.values()
    ]
    late = write_velocities(here / "d", in_unit=np.array([*factors, *factors]))
    assert main(["import", "d", "--unit", "range", "--calibration", "cal.json", "--out", "out"]) == 0
    np.testing.assert_allclose(read(here / "out").states[:, 2:], late[:-1], rtol=1e-5, atol=1e-5)


def test_velocities_of_the_states_are_a_signal_where_the_map_derives_others(here):
    (here / "map.toml").write_text(RADIANS)
    late = write_velocities(here / "d")
    assert main(["import", "d", "--map", "map.toml", "--out", "out"]) == 0
    dataset = read(here / "out")
    feature = dataset.features["nas.velocity"]
    assert (feature.names, feature.units) == (("j1.velocity", "j2.velocity"), ("rad/s", "rad/s"))
    np.testing.assert_allclose(dataset.columns["nas.velocity"], late[:-1], atol=1e-5)
    assert "velocities" in read_provenance(here / "out").derived[STATE]
    assert np.abs(dataset.states[:, 2:] - late[:-1]).max() > 1


@pytest.mark.parametrize("factor", [DEGREES, 1 / DEGREES])
def test_velocities_in_another_unit_than_the_positions_are_not_those_of_the_state(here, capsys, factor):
    late = write_velocities(here / "d", factor)
    assert main(["import", "d", "--unit", "rad", "--out", "out"]) == 0
    assert "Velocities are derived, because the recorded ones contradict the positions" in capsys.readouterr().out
    dataset = read(here / "out")
    np.testing.assert_allclose(dataset.columns["nas.velocity"], late[:-1], rtol=1e-5)
    assert 0.3 < np.abs(dataset.states[:, 2:]).max() / np.abs(late / factor).max() < 2
    assert 'velocity = "derive"' in (here / "out/meta/import_map.toml").read_text()


@pytest.mark.parametrize("order", [("a", "bare"), ("bare", "a")])
def test_velocities_that_not_every_dataset_has_are_derived(here, capsys, order):
    late = write_velocities(here / "a")
    write_lerobot(here / "bare", motions(1, 120))
    assert main(["import", *order, "--unit", "rad", "--out", "out"]) == 0
    said = capsys.readouterr().out
    assert "left out: j1.vel, j2.vel of observation.state" in said
    assert ("Velocities are derived, because the states of bare do not hold all" in said) == (order[0] == "a")
    dataset = read(here / "out")
    first, second = dataset.episodes()
    np.testing.assert_allclose(dataset.states[first], dataset.states[second], atol=1e-5)
    assert np.abs(dataset.states[first, 2:] - late[:-1]).max() > 1
    assert "velocities" in read_provenance(here / "out").derived[STATE]
    text = (here / "out/meta/import_map.toml").read_text()
    assert 'velocity = "derive"' in text and "read.velocity" not in text and "[read.command]" in text
    (here / "map.toml").write_text(text)
    assert main(["import", *order, "--map", "map.toml", "--unit", "rad", "--out", "again"]) == 0
    np.testing.assert_array_equal(read(here / "again").states, dataset.states)


@pytest.mark.parametrize("unit", [["--unit", "rad"], []])
def test_torques_that_the_states_hold_are_named_as_left_out(here, capsys, unit):
    write_velocities(here / "d")
    info = here / "d/meta/info.json"
    info.write_text(info.read_text().replace(".vel", ".effort", 2))
    assert main(["import", "d", *unit, "--out", "out"]) == 0
    assert "left out: j1.effort, j2.effort" in capsys.readouterr().out


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
