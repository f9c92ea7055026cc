"""Servo registers of a recording change the model before the search: once, and only where it states its own."""

import json
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from support.recording_samples import recorded_on, wander
from support.xl320_samples import be_patient, be_quick

import nas_data as nas
from nas_data.cli import main
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.derive_provenance import Original, join_registers
from nas_data.dataset.origin import Origin
from nas_data.dataset.provenance import Provenance
from nas_data.effects.base import parse
from nas_data.errors import ModelFileError
from nas_data.gap.model_correction import ModelCorrection
from nas_data.robots.base import FOLDER, Robot, find_robot
from nas_data.simulators.mujoco import MujocoSimulator
from nas_data.simulators.servo_registers import SPEED_UNIT, ServoRegisters

PENDULUM = (FOLDER / "pendulum.xml").read_text()
STATED = """<custom><numeric name="p_gain" data="400"/><numeric name="torque_limit" data="1000"/>
<numeric name="moving_speed" data="0"/></custom>"""
FULL = {"p_gain": 400, "torque_limit": 1000, "moving_speed": 0}
# Each register with the effect that it is in the arm; the model's torque limit is 0.7124 N·m.
CHANGED = {
    "p_gain": ({"p_gain": 200}, "servo_stiffness:joint=pendulum,factor=0.5"),
    "torque_limit": ({"torque_limit": 250}, "torque_limit:joint=pendulum,torque=0.1781"),
    "max_torque": ({"max_torque": 250}, "torque_limit:joint=pendulum,torque=0.1781"),
    "moving_speed": ({"moving_speed": 100}, f"speed_limit:joint=pendulum,speed={100 * SPEED_UNIT}"),
}


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    """Return the file of a pendulum that states the registers of its values."""
    path = tmp_path / "arm.xml"
    path.write_text(PENDULUM.replace("<actuator>", f"{STATED}<actuator>"))
    return path


def told(dataset: Dataset, *registers: dict[str, int]) -> Dataset:
    """Return a recording whose provenance holds registers; each change is in the next episode."""
    history = [{"from_episode": i, "joints": {"pendulum": dict(held)}} for i, held in enumerate(registers)]
    provenance = Provenance(how="hardware", robot="pendulum", target={"registers": history}, contiguous=True)
    return replace(dataset, origin=Origin(dataset, provenance))


def recording(effect: str, episodes: int = 6) -> Dataset:
    """Return a recording of the pendulum with an effect."""
    target = MujocoSimulator.load("pendulum", 0.02, effects=[parse(effect)], threads=1)
    return recorded_on(target, wander([100] * episodes))


def read(*registers: dict[str, int]) -> ServoRegisters:
    return ServoRegisters.read(told(recording("command_delay:delay=0", 1), *registers).origin.provenance, ("pendulum",))


def source_error(model: Path, dataset: Dataset) -> float:
    """Return the open-loop error of a model [rad]."""
    found = nas.evaluate(model, dataset, model=model, plain_fit=False)
    return found.open_loop["source"].overall


def compiled(robot: Robot) -> mujoco.MjModel:
    return robot.spec().compile()


@pytest.mark.parametrize(("registers", "effect"), CHANGED.values(), ids=CHANGED)
def test_each_register_moves_the_model_as_it_moves_the_arm(registers, effect, arm):
    dataset = recording(effect)
    assert source_error(arm, told(dataset, FULL)) > 0.02
    assert source_error(arm, told(dataset, FULL | registers)) < 1e-4


def test_a_known_gain_is_not_named_and_an_unknown_one_is(arm, tmp_path):
    dataset = recording(CHANGED["p_gain"][1])
    known = nas.identify(told(dataset, FULL | {"p_gain": 200}), model=arm, out=tmp_path / "known")
    assert (known.verdict, known.effects) == ("none", ())
    assert known.registers["p_gain"] == {"pendulum": 200}
    (model,) = [check.finding for check in known.find.audit if check.check == "model"]
    assert "the position gain is multiplied by 0.5 (p_gain 200, in the model 400) in pendulum" in model
    hidden = nas.identify(dataset, model=arm)
    assert [(found.name, found.joint) for found in hidden.effects] == [("servo_stiffness", "pendulum")]
    assert hidden.effects[0].parameters["factor"].value == pytest.approx(0.5, rel=0.03)
    assert hidden.registers is None

    # what is delivered has the registers, once, whether as a file or as what to add to the given model
    difference = (tmp_path / "known/model.diff").read_text()
    assert '+    <numeric name="pendulum_p_gain" data="200"/>' in difference.replace('size="1" ', "")
    written = tmp_path / "known/model.xml"
    assert source_error(written, told(dataset, FULL | {"p_gain": 200})) < 0.002
    assert source_error(written, dataset) < 0.002
    for file in ("effects.json", "report.json"):
        robot = ModelCorrection.read(tmp_path / "known" / file).robot(find_robot(arm), ("pendulum",))
        gain = compiled(robot).actuator_gainprm[0, 0]
        assert gain == pytest.approx(compiled(find_robot(written)).actuator_gainprm[0, 0], rel=1e-3)


def test_registers_are_set_once(arm):
    registers = read({"p_gain": 100, "torque_limit": 250, "moving_speed": 50})
    once = registers.set_in(find_robot(arm))
    twice = registers.set_in(once)
    assert once.spec().to_xml() == twice.spec().to_xml()
    assert registers.describe(once) == ()
    back = read(FULL).set_in(twice)
    model, plain = compiled(back), compiled(find_robot(arm))
    assert model.actuator_biasprm[0, 1] == pytest.approx(plain.actuator_biasprm[0, 1])
    assert model.actuator_forcerange[0] == pytest.approx(plain.actuator_forcerange[0])
    assert model.actuator_dynprm[0, 1] == 0  # no slew rate


def test_a_model_that_states_nothing_stays_and_says_what_to_add(tmp_path):
    path = tmp_path / "silent.xml"
    path.write_text(PENDULUM)
    robot, registers = find_robot(path), read(FULL | {"p_gain": 200})
    assert registers.set_in(robot) is robot
    (sentence,) = registers.describe(robot)
    assert 'add <custom><numeric name="p_gain" data="…"/></custom>' in sentence


def test_registers_that_differ_between_episodes_are_not_used(arm):
    registers = read(FULL, FULL | {"p_gain": 200})
    assert sorted(registers.values) == ["moving_speed", "torque_limit"]
    assert "p_gain differ between episodes" in registers.describe(find_robot(arm))[0]


def test_a_servo_that_filters_its_command_gets_no_speed_limit(tmp_path, arm):
    path = tmp_path / "filtered.xml"
    path.write_text(arm.read_text().replace("<position ", '<position timeconst="0.1" '))
    registers = read(FULL | {"moving_speed": 100})
    robot = registers.set_in(find_robot(path))
    assert "moving_speed" not in robot.spec().to_xml().replace('name="moving_speed"', "")
    assert "not used in pendulum" in registers.describe(find_robot(path))[0]


@pytest.mark.parametrize("value", [0, -3])
def test_a_stated_gain_is_above_zero(value, arm):
    arm.write_text(arm.read_text().replace('data="400"', f'data="{value}"'))
    with pytest.raises(ModelFileError, match="a position gain is above 0"):
        read(FULL).set_in(find_robot(arm))


@pytest.mark.parametrize(("name", "value"), [("P_Coefficient", 200), ("Position_P_Gain", 200)])
def test_lerobots_names_are_known(name, value):
    assert read({name: value}).values == {"p_gain": {"pendulum": 200.0}}


def test_what_is_no_setting_of_a_moving_servo_is_left_out():
    assert read({"p_gain": 0, "torque_limit": 0, "id": 3, "punch": 32}).values == {}


def test_merged_recordings_keep_their_registers():
    one = told(recording("command_delay:delay=0", 2), FULL)
    other = told(recording("command_delay:delay=0", 3), FULL | {"p_gain": 200})
    originals = [Original(Path("a"), each, each.origin.provenance) for each in (one, one, other)]
    history = join_registers(originals)["registers"]
    assert [entry["from_episode"] for entry in history] == [0, 4]
    assert history[1]["joints"]["pendulum"]["p_gain"] == 200
    unknown = Original(Path("c"), one, Provenance(how="hardware", target={}))
    assert join_registers([*originals, unknown]) is None


RECORD = ("record", "ergojr", "--port", "virtual", "--lockstep", "--rate", "50", "--seconds", "2")
SOFT = ("--p-gain", "16", "--torque", "0.7", "--speed", "1.5")


def record_ergojr(monkeypatch, folder: Path, *options: str) -> Path:
    be_patient(monkeypatch)
    be_quick(monkeypatch)
    monkeypatch.setenv("HF_LEROBOT_CALIBRATION", str(folder / "calibration"))
    assert main([*RECORD, *options, "--out", str(folder / "soft")]) == 0
    return folder / "soft"


def hide(root: Path) -> None:
    """Remove the registers from a recording."""
    path = root / "meta/nas.json"
    content = json.loads(path.read_text())
    content["target"]["registers"] = []
    path.write_text(json.dumps(content))


def test_a_virtual_ergojr_is_predicted_by_its_registers(monkeypatch, tmp_path):
    root = record_ergojr(monkeypatch, tmp_path, *SOFT, "--episodes", "2", "--excitation", "steps:share=0.5")
    known = nas.evaluate("ergojr", root, model="ergojr", plain_fit=False)
    assert len([note for note in known.notes if "registers" in note]) == 3
    hide(root)
    hidden = nas.evaluate("ergojr", root, model="ergojr", plain_fit=False)
    assert known.open_loop["source"].overall < np.radians(1)
    assert hidden.open_loop["source"].overall > np.radians(4)


@pytest.mark.slow
def test_nothing_is_named_in_a_virtual_ergojr_of_another_gain(monkeypatch, tmp_path):
    sine = ("--excitation", "sine:slowest=0.2,fastest=0.6,share=0.5")
    root = record_ergojr(monkeypatch, tmp_path, "--p-gain", "16", "--speed", "0", "--episodes", "6", *sine)
    report = nas.identify(root, model="ergojr")
    assert report.effects == ()
    assert set(report.registers["p_gain"].values()) == {16}
    hide(root)
    named = {(found.name, found.joint) for found in nas.identify(root, model="ergojr").effects}
    assert named == {("servo_stiffness", joint) for joint in find_robot("ergojr").joints}
