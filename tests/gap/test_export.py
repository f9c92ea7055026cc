"""An identified model as parameters that others read: BAM's files, and a table with ranges to randomise in."""

import csv
import json
import math

import numpy as np
import pytest

from nas_data.cli import main
from nas_data.effects.base import parse
from nas_data.gap.episode_batch import EpisodeBatch
from nas_data.gap.exporting import bam
from nas_data.gap.exporting.identified import Quantity, list_quantities, read_intervals
from nas_data.gap.nominal import Nominal
from nas_data.gap.problem import Problem

ARM = """<mujoco><compiler angle="radian" autolimits="true"/><option timestep="0.002" integrator="implicitfast"/>
<worldbody><body pos="0 0 0.5"><joint name="a" axis="0 1 0" damping="0.05" armature="0.002" frictionloss="0.01"/>
<geom type="capsule" fromto="0 0 0 0.15 0 0" size="0.01" mass="0.05" contype="0" conaffinity="0"/>
<body pos="0.15 0 0"><joint name="b" type="slide" axis="1 0 0" damping="1" range="-0.05 0.05"/>
<geom type="capsule" fromto="0 0 0 0.1 0 0" size="0.01" mass="0.03" contype="0" conaffinity="0"/></body></body>
</worldbody><actuator><position joint="a" kp="4" kv="0.2"/><position joint="b" kp="200" kv="2"/></actuator></mujoco>"""
VISCOUS, DRY = ("viscous_friction", "a", "coefficient", 0.03), ("coulomb_friction", "a", "torque", 0.02)
LIMIT, LOAD = ("torque_limit", "a", "torque", 1.5), ("load_friction", "a", "ratio", 0.2)
DELAY, PLAY = ("command_delay", None, "delay", 0.02), ("backlash", "a", "half_width", 0.02)


def effects_json(*effects: tuple[str, str | None, str, float]) -> dict[str, object]:
    entries = [{"effect": name, "joint": joint, "parameters": {key: value}} for name, joint, key, value in effects]
    return {"schema": 1, "effects": entries, "retuned": {"a.gain": 1.1}}


def report_json(*effects: tuple[str, str | None, str, float], off: float = 1.0) -> dict[str, object]:
    def number(value: float) -> dict[str, object]:
        return {"value": off * value, "unit": "", "interval95": [0.9 * value, 1.2 * value]}

    return {"effects": [{"effect": n, "joint": j, "parameters": {k: number(v)}} for n, j, k, v in effects]}


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    """A folder with a model and a recording of it, and what `nas gap` is given of both."""
    folder = tmp_path_factory.mktemp("export")
    (folder / "arm.xml").write_text(ARM)
    line = f"record sim --robot {folder / 'arm.xml'} --episodes 3 --seconds 0.5 --rate 50 --out {folder / 'data'}"
    assert main(line.split()) == 0
    return folder, Problem.load(folder / "data", folder / "arm.xml").train.nominal


def quantities(arm, *effects: tuple[str, str | None, str, float], report: dict | None = None, tmp=None):
    made = [parse(f"{n}:{'' if j is None else f'joint={j},'}{k}={v}") for n, j, k, v in effects]
    intervals = {}
    if report is not None:
        (tmp / "report.json").write_text(json.dumps(report))
        intervals = read_intervals(tmp, made)
    return {(q.joint, q.name): q for q in list_quantities(arm[1], made, {"a.gain": 1.1}, intervals)}


def test_what_an_effect_adds_stands_beside_what_the_joint_has_with_the_interval_moved_along(arm, tmp_path):
    effects = (VISCOUS, DRY, LIMIT, LOAD, DELAY, PLAY)
    found = quantities(arm, *effects, report=report_json(*effects), tmp=tmp_path)
    expected = {
        ("a", "gain"): (4.4, "N·m/rad", None),
        ("a", "servo_damping"): (0.2, "N·m·s/rad", None),
        ("a", "armature"): (0.002, "kg·m²", None),
        ("a", "dry_friction"): (0.03, "N·m", (0.028, 0.034)),
        ("a", "viscous_friction"): (0.08, "N·m·s/rad", (0.077, 0.086)),
        ("a", "torque_limit"): (1.5, "N·m", (1.35, 1.8)),
        ("a", "load_friction"): (0.2, "", (0.18, 0.24)),
        ("a", "backlash"): (0.02, "rad", (0.018, 0.024)),
        ("b", "gain"): (200, "N/m", None),
        ("b", "servo_damping"): (2, "N·s/m", None),
        ("b", "viscous_friction"): (1, "N·s/m", None),
        ("a", "mass"): (0.05, "kg", None),
        ("b", "mass"): (0.03, "kg", None),
        (None, "command_delay"): (0.02, "s", (0.018, 0.024)),
    }
    assert found.keys() == expected.keys()
    for key, (value, unit, interval) in expected.items():
        assert found[key].value == pytest.approx(value) and found[key].unit == unit, key
        assert found[key].interval == (None if interval is None else pytest.approx(interval)), key


SPEEDS = """<mujoco><compiler angle="radian" autolimits="true"/>
<worldbody><body pos="0 0 0.5"><joint name="a" axis="0 1 0"/><geom size="0.05" mass="0.2"/>
<body pos="0.15 0 0"><joint name="b" type="slide" axis="1 0 0" damping="1"/><geom size="0.02" mass="0.1"/></body></body>
</worldbody><actuator><intvelocity joint="a" kp="4" kv="0.2"/><velocity joint="b" kv="30" forcerange="-5 5"/></actuator>
</mujoco>"""


def test_a_velocity_servos_feedback_is_its_gain_and_changed_masses_and_payloads_are_listed(tmp_path):
    (tmp_path / "arm.xml").write_text(SPEEDS)
    nominal = Nominal.load(tmp_path / "arm.xml", motionless(("a", "b")))
    effects = [parse("servo_damping:joint=b,factor=0.5"), parse("payload:mass=0.3")]
    limit = parse("torque_limit:joint=b,torque=2")
    found = list_quantities(nominal, [*effects, limit], {"b.mass": 1.2, "a.gain": 1.1}, {})
    assert {(q.joint, q.name): (round(q.value, 9), q.unit) for q in found} == {
        ("a", "gain"): (4.4, "N·m/rad"),
        ("a", "servo_damping"): (0.2, "N·m·s/rad"),
        ("a", "mass"): (0.2, "kg"),
        ("b", "velocity_gain"): (15.0, "N·s/m"),
        ("b", "viscous_friction"): (1.0, "N·s/m"),
        ("b", "torque_limit"): (2.0, "N"),
        ("b", "mass"): (0.12, "kg"),
        (None, "payload"): (0.3, "kg"),
    }


def motionless(joints: tuple[str, ...]) -> EpisodeBatch:
    rows = np.zeros((1, 10, len(joints)))
    return EpisodeBatch(joints, 0.02, rows[:, 0], rows, rows, np.ones((1, 10), bool), np.arange(1))


def test_intervals_of_another_report_are_not_taken(arm, tmp_path):
    found = quantities(arm, VISCOUS, report=report_json(VISCOUS, off=1.3), tmp=tmp_path)
    assert found["a", "viscous_friction"].interval is None


@pytest.mark.parametrize("limit", [(), (LIMIT,)])
def test_bam_s_motor_gives_the_torque_of_the_servo(limit, arm):
    """Compute the torque as `VoltageControlledActuator` does, at errors and speeds within and beyond saturation."""
    found = quantities(arm, *limit)
    written, lost = bam.convert_parameters({name: q.value for (joint, name), q in found.items() if joint == "a"})
    assert lost == [] and written["model"] == "m1" and written["actuator"] == "sts3215"
    error, speed = np.meshgrid(np.linspace(-1, 1, 21), np.linspace(-2, 2, 5))
    duty = np.clip(error * 32 * 0.166 * written["error_gain_ratio"], -0.97, 0.97)
    torque = written["kt"] / written["R"] * 7.4 * duty - written["kt"] ** 2 / written["R"] * speed
    largest = 1.5 if limit else 4.4 * 0.97 / (32 * 0.166)  # without a limit of ours BAM's duty is the limit
    assert torque == pytest.approx(np.clip(4.4 * error, -largest, largest) - 0.2 * speed)


def test_frictions_are_those_of_bam_s_models():
    own = {"gain": 4.0, "servo_damping": 0.2, "dry_friction": 0.05}
    own |= {"stribeck_friction.torque": 0.1, "stribeck_friction.kinetic_ratio": 0.4}
    own |= {"stribeck_friction.stribeck_velocity": 0.3, "load_friction": 0.2}
    content, _ = bam.convert_parameters(own)
    assert content["model"] == "m4" and content["alpha"] == 2.0
    speed, motor = 0.2, 0.7  # Model.compute_frictions of BAM, at rest under load: the external torque is the opposite
    fall = math.exp(-(abs(speed / content["dtheta_stribeck"]) ** content["alpha"]))
    friction = content["friction_base"] + content["load_friction_base"] * abs(-motor - motor)
    friction += fall * content["friction_stribeck"]
    kinetic = 0.05 - 0.1 * 0.4  # what the joint has itself
    assert friction == pytest.approx(kinetic + 0.1 * (0.4 + 0.6 * math.exp(-((0.2 / 0.3) ** 2))) + 0.2 * 0.7)
    assert bam.convert_parameters({"gain": 4.0, "servo_damping": 0.2, "load_friction": 0.2})[0]["model"] == "m3"
    without = {key: own[key] for key in own if key != "load_friction"}
    assert bam.convert_parameters(without)[0]["model"] == "m2"


def test_friction_under_load_that_falls_with_speed_is_bam_s_m4():
    own = {"gain": 4.0, "servo_damping": 0.2, "load_friction.ratio": 0.2, "load_friction.kinetic_ratio": 0.4}
    own |= {"load_friction.stribeck_velocity": 0.3}
    content, lost = bam.convert_parameters(own)
    assert content["model"] == "m4" and content["friction_stribeck"] == 0.0 and not lost
    speed, motor = 0.2, 0.7
    fall = math.exp(-(abs(speed / content["dtheta_stribeck"]) ** content["alpha"]))
    share = content["load_friction_base"] + fall * content["load_friction_stribeck"]
    assert share * 2 * motor == pytest.approx(0.2 * 0.7 * (0.4 + 0.6 * math.exp(-((0.2 / 0.3) ** 2))))
    own |= {"stribeck_friction.torque": 0.1, "stribeck_friction.kinetic_ratio": 0.4}
    both, lost = bam.convert_parameters(own | {"stribeck_friction.stribeck_velocity": 0.5})
    assert both["dtheta_stribeck"] == 0.5 and lost == ["load_friction.stribeck_velocity"]


def test_what_bam_has_no_place_for_is_said():
    content, lost = bam.convert_parameters({"dry_friction": 0.1, "backlash": 0.02, "torque_limit": 1.0})
    assert "kt" not in content and content["friction_base"] == 0.1
    assert lost == ["backlash", "kt and R, as the joint has no position servo", "torque_limit"]


@pytest.mark.parametrize("kind", ["bam", "csv"])
def test_the_command_writes_the_parameters_beside_the_model(kind, arm, tmp_path, capsys):
    folder, _ = arm
    effects = (VISCOUS, DELAY, PLAY)
    report = tmp_path / "report"
    report.mkdir()
    (report / "effects.json").write_text(json.dumps(effects_json(*effects)))
    (report / "report.json").write_text(json.dumps(report_json(*effects)))
    line = f"gap add {folder / 'data'} --model {folder / 'arm.xml'} --effects {report} --out {tmp_path / 'out'}"
    assert main([*line.split(), "--export", kind]) == 0
    said = capsys.readouterr()
    if kind == "csv":
        with (tmp_path / "out/parameters.csv").open(encoding="utf-8") as file:
            rows = {(row["joint"], row["parameter"]): row for row in csv.DictReader(file)}
        delay, gain = rows["", "command_delay"], rows["a", "gain"]
        assert [float(delay[name]) for name in ("value", "low", "high")] == pytest.approx([0.02, 0.018, 0.024])
        assert float(gain["value"]) == pytest.approx(4.4) and gain["low"] == gain["high"] == ""
        assert "parameters.csv" in said.out and "because they have no interval" in said.err
    else:
        content = json.loads((tmp_path / "out/bam/a.json").read_text())
        assert content["command_delay"] == 0.02 and content["friction_viscous"] == pytest.approx(0.08)
        assert [path.name for path in (tmp_path / "out/bam").iterdir()] == ["a.json"]
        for lost in ("a: backlash", "b, which is a slide", "their ranges"):
            assert lost in said.err


def test_a_report_that_is_none_is_refused(arm, tmp_path, capsys):
    folder, _ = arm
    (tmp_path / "effects.json").write_text(json.dumps(effects_json(VISCOUS)))
    (tmp_path / "report.json").write_text("[1]")
    line = f"gap add {folder / 'data'} --model {folder / 'arm.xml'} --effects {tmp_path} --out {tmp_path / 'out'}"
    assert main([*line.split(), "--export", "csv"]) == 2
    assert "is not a gap report; give the folder" in capsys.readouterr().err


def test_effects_of_other_files_are_exported_without_intervals(arm, tmp_path):
    folder, _ = arm
    (tmp_path / "mine.json").write_text(json.dumps(effects_json(VISCOUS)))
    line = f"gap add {folder / 'data'} --model {folder / 'arm.xml'} --effects {tmp_path / 'mine.json'}"
    assert main([*line.split(), "--out", str(tmp_path / "out"), "--export", "csv"]) == 0
    assert (tmp_path / "out/parameters.csv").is_file()


def test_delays_of_arm_and_joint_add_up_and_each_joint_has_a_file_of_its_own(tmp_path):
    delays = [Quantity(joint, "command_delay", "s", value, None) for joint, value in ((None, 0.02), ("a b", 0.01))]
    folder, _ = bam.write_bam(tmp_path, ["a b", "a_b"], delays)
    found = {path.name: json.loads(path.read_text())["command_delay"] for path in folder.iterdir()}
    assert found == {"a_b.json": pytest.approx(0.03), "a_b1.json": pytest.approx(0.02)}
