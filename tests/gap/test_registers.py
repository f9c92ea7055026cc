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
from nas_data.dataset.features import Feature
from nas_data.dataset.origin import Origin
from nas_data.dataset.provenance import Provenance
from nas_data.dataset.target_episodes import join_targets, select_episodes
from nas_data.effects.base import Effect, add_effects, parse
from nas_data.effects.edits.servo import read_torque_limit
from nas_data.errors import ModelFileError
from nas_data.gap.model_correction import ModelCorrection
from nas_data.reports.films.motion import follow
from nas_data.robots.base import FOLDER, Robot, find_robot
from nas_data.simulators.goal_registers import read_goal_band
from nas_data.simulators.mujoco import MujocoSimulator
from nas_data.simulators.register_kinds import PROFILE_ACCELERATION, PROFILE_SPEED, SPEED_UNIT, STEEP_STEP, STEP
from nas_data.simulators.servo_registers import ServoRegisters
from nas_data.studies.ablation.sweep_data import SweepData

PENDULUM = (FOLDER / "pendulum.xml").read_text()
STATED = """<custom><numeric name="p_gain" data="400"/><numeric name="torque_limit" data="1000"/>
<numeric name="moving_speed" data="0"/></custom>"""
FULL = {"p_gain": 400, "torque_limit": 1000, "moving_speed": 0}
LOW = FULL | {"p_gain": 200}
# Each register with the effect that it is in the arm; the model's torque limit is 0.7124 N·m.
CHANGED = {
    "p_gain": ({"p_gain": 200}, "servo_stiffness:joint=pendulum,factor=0.5"),
    "torque_limit": ({"torque_limit": 250}, "torque_limit:joint=pendulum,torque=0.1781"),
    "max_torque": ({"max_torque": 250}, "torque_limit:joint=pendulum,torque=0.1781"),
    "moving_speed": ({"moving_speed": 100}, f"speed_limit:joint=pendulum,speed={100 * SPEED_UNIT}"),
}
# Registers in SI, of which the model states nothing.
ABSOLUTE = {
    "Goal_Velocity": ({"Goal_Velocity": 700}, f"speed_limit:joint=pendulum,speed={700 * STEP}"),
    "Profile_Velocity": ({"Profile_Velocity": 40}, f"speed_limit:joint=pendulum,speed={40 * PROFILE_SPEED}"),
    "Acceleration": (
        {"Acceleration": 20, "Maximum_Acceleration": 254},
        f"acceleration_limit:joint=pendulum,acceleration={20 * STEEP_STEP}",
    ),
    "Maximum_Acceleration": (
        {"Acceleration": 254, "Maximum_Acceleration": 20},
        f"acceleration_limit:joint=pendulum,acceleration={20 * STEEP_STEP}",
    ),
    "Profile_Acceleration": (
        {"Profile_Velocity": 2000, "Profile_Acceleration": 8},  # a speed above 30 rad/s is no limit
        f"acceleration_limit:joint=pendulum,acceleration={8 * PROFILE_ACCELERATION}",
    ),
    "CW_Dead_Zone": (
        {"CW_Dead_Zone": 32, "CCW_Dead_Zone": 20},
        f"deadband:joint=pendulum,half_width={32 * STEP}",
    ),
    "punch": ({"punch": 400}, f"start_torque:joint=pendulum,torque={400 / 1023 * 0.7124}"),
    "Minimum_Startup_Force": ({"Minimum_Startup_Force": 400}, "start_torque:joint=pendulum,torque=0.28496"),
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


def positions(robot: Robot, *effects: Effect) -> np.ndarray:
    """Return where a pendulum is [rad] in two episodes."""
    commands = np.stack(wander([100, 100]))
    return MujocoSimulator(robot, 0.02, effects=effects, threads=1).rollout(np.zeros((2, 2)), commands)[..., 0]


def compiled(robot: Robot) -> mujoco.MjModel:
    return robot.spec().compile()


@pytest.mark.parametrize(("registers", "effect"), CHANGED.values(), ids=CHANGED)
def test_each_register_moves_the_model_as_it_moves_the_arm(registers, effect, arm):
    dataset = recording(effect)
    assert source_error(arm, told(dataset, FULL)) > 0.02
    assert source_error(arm, told(dataset, FULL | registers)) < 1e-4


@pytest.mark.parametrize(("registers", "effect"), ABSOLUTE.values(), ids=ABSOLUTE)
def test_a_register_in_si_needs_no_statement_of_the_model(registers, effect):
    plain = find_robot("pendulum")
    changed = positions(plain, parse(effect))
    assert np.abs(positions(plain) - changed).max() > 0.03
    assert positions(read(registers).set_in(plain)) == pytest.approx(changed, abs=1e-9)


@pytest.mark.slow
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
    root, effects, added = dataset.save(tmp_path / "data"), tmp_path / "known/effects.json", tmp_path / "added"
    words = ["--model", str(arm), "--effects", str(effects), "--out", str(added)]
    assert main(["gap", "add", str(root), *words]) == 0
    assert compiled(find_robot(added / "model.xml")).actuator_gainprm[0, 0] == pytest.approx(gain, rel=1e-3)


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


EVERYTHING = {
    "p_gain": 200, "torque_limit": 500, "Goal_Velocity": 700, "Acceleration": 20, "CW_Dead_Zone": 32,
    "CCW_Dead_Zone": 32, "Minimum_Startup_Force": 200,
}  # fmt: skip
MILD = EVERYTHING | {"Acceleration": 253, "CW_Dead_Zone": 2, "CCW_Dead_Zone": 1, "Minimum_Startup_Force": 100}


def test_all_registers_together_are_set_once_and_replaced_by_others(arm):
    once = read(EVERYTHING).set_in(find_robot(arm))
    assert read(EVERYTHING).set_in(once).spec().to_xml() == once.spec().to_xml()
    assert read(EVERYTHING).describe(once) == ()
    changed, direct = read(MILD).set_in(once), read(MILD).set_in(find_robot(arm))
    assert read_goal_band(changed.spec(), "pendulum") == pytest.approx(read_goal_band(direct.spec(), "pendulum"))
    assert positions(changed) == pytest.approx(positions(direct), abs=1e-6)
    assert np.abs(positions(changed) - positions(once)).max() > 0.05


def test_registers_that_are_switched_off_leave_no_dead_zone_and_no_least_output(arm):
    once = read(EVERYTHING).set_in(find_robot(arm))
    off = read(EVERYTHING | {"CW_Dead_Zone": 0, "CCW_Dead_Zone": 0, "Minimum_Startup_Force": 0}).set_in(once)
    assert read_goal_band(off.spec(), "pendulum") == (0.0, 0.0)
    assert off.spec().actuator("pendulum_start_torque") is None


def test_the_least_output_is_a_share_of_the_full_torque(arm):
    """At a quarter of the torque the limit falls, and the punch does not."""
    robot = read(FULL | {"torque_limit": 250, "punch": 100}).set_in(find_robot(arm))
    assert read_goal_band(robot.spec(), "pendulum")[1] == pytest.approx(100 / 1000 * 0.7124)
    assert read_torque_limit(robot.spec(), "pendulum") == pytest.approx(0.1781)


def test_what_a_model_has_without_a_statement_is_left_alone(tmp_path):
    path = tmp_path / "own.xml"
    spec = mujoco.MjSpec.from_string(PENDULUM)
    own = ("speed_limit:joint=pendulum,speed=2", "acceleration_limit:joint=pendulum,acceleration=9",
           "deadband:joint=pendulum,half_width=0.01", "start_torque:joint=pendulum,torque=0.1")  # fmt: skip
    add_effects(spec, map(parse, own))
    path.write_text(spec.to_xml())
    registers = read({"Goal_Velocity": 700, "Acceleration": 20, "CW_Dead_Zone": 32, "Minimum_Startup_Force": 400})
    robot = find_robot(path)
    assert registers.set_in(robot) is robot
    sentences = registers.describe(robot)
    assert len(sentences) == 4
    assert all("of its own: state the register for which it holds" in sentence for sentence in sentences)


def test_a_robots_own_punch_changes_nothing_and_another_one_does():
    robot = find_robot("ergojr")
    names = robot.joints
    default = ServoRegisters({"punch": dict.fromkeys(names, 32.0)})
    assert compiled(default.set_in(robot)).nu == compiled(robot).nu == 6
    assert default.describe(robot) == ()
    raised = ServoRegisters({"punch": {**dict.fromkeys(names, 32.0), "m2": 153.0}}).set_in(robot)
    assert read_goal_band(raised.spec(), "m2")[1] == pytest.approx(153 / 1023 * 0.2079)
    assert read_goal_band(raised.spec(), "m3") == (0.0, 0.0)


SERVO = '<position name="pendulum" joint="pendulum" kp="0.8198" forcerange="-0.7124 0.7124"/>'
PID = '<pid name="pendulum" joint="pendulum" kp="0.8" ki="1.5" imax="0.4" kv="0.1" forcerange="-0.7 0.7"/>'
GAINS = '<custom><numeric name="d_gain" data="32"/><numeric name="i_gain" data="4"/></custom>'


def with_servo(folder: Path, servo: str, stated: str = GAINS) -> Robot:
    """Return the pendulum with another servo that states its own gains."""
    assert SERVO in PENDULUM
    path = folder / "servo.xml"
    path.write_text(PENDULUM.replace(SERVO, servo).replace("<actuator>", f"{stated}<actuator>"))
    return find_robot(path)


@pytest.mark.parametrize("names", [("d_gain", "i_gain"), ("D_Coefficient", "I_Coefficient"),
                                   ("Position_D_Gain", "Position_I_Gain")])  # fmt: skip
def test_derivative_and_integral_gain_are_multiples_of_the_models_own(names, tmp_path):
    robot = with_servo(tmp_path, PID)
    plain, model = compiled(robot), compiled(read(dict(zip(names, (16, 8), strict=True))).set_in(robot))
    assert model.actuator_biasprm[0, 1:3] == pytest.approx(plain.actuator_biasprm[0, 1:3] * [1, 0.5])
    assert model.actuator_gainprm[0, 0] == pytest.approx(2 * plain.actuator_gainprm[0, 0])
    bounds = [each.actuator_gainprm[0, 0] * each.actuator_dynprm[0, 0] for each in (model, plain)]
    assert bounds[0] == pytest.approx(bounds[1])


def test_gains_of_zero_switch_off_derivative_and_integral_part(tmp_path):
    robot = with_servo(tmp_path, PID)
    model = compiled(read({"d_gain": 0, "i_gain": 0}).set_in(robot))
    assert model.actuator_biasprm[0, 2] == model.actuator_gainprm[0, 0] == model.na == 0


def test_a_damping_ratio_is_a_derivative_gain_as_well(tmp_path):
    robot = with_servo(tmp_path, SERVO.replace("/>", ' dampratio="0.5"/>'))
    plain, model = compiled(robot), compiled(read({"d_gain": 16}).set_in(robot))
    assert plain.actuator_biasprm[0, 2] < 0
    assert model.actuator_biasprm[0, 2] == pytest.approx(0.5 * plain.actuator_biasprm[0, 2])


ZERO = GAINS.replace('"32"', '"0"').replace('"4"', '"0"')
UNUSED = {
    "no feedback": (SERVO, GAINS, {"d_gain": 16}, "servo has no velocity feedback"),
    "no integral": (SERVO, GAINS, {"i_gain": 8}, "servo has no integral gain"),
    "D of zero": (PID, ZERO, {"d_gain": 16}, "states 0, which has no multiples"),
    "I of zero": (PID, ZERO, {"i_gain": 8}, "states 0, which has no multiples"),
    "D unknown": (PID, "", {"d_gain": 0}, "registers d_gain are not used, because the model does not state"),
    "I unknown": (PID, "", {"i_gain": 0}, "registers i_gain are not used, because the model does not state"),
    "integral": (PID, "", {"Acceleration": 20}, "servo has an integral gain"),
    "torque": (SERVO.replace('forcerange="-0.7124 0.7124"', ""), "", {"punch": 64}, "no torque limit, of which"),
    "motor": ('<motor joint="pendulum"/>', "", {"Goal_Velocity": 64}, "actuator is no position servo"),
    "time": (SERVO, "", {"Profile_Velocity": 64, "Drive_Mode": 4}, "based on time"),
}


@pytest.mark.parametrize(("servo", "stated", "registers", "reason"), UNUSED.values(), ids=UNUSED)
def test_what_cannot_be_used_changes_nothing_and_is_said(servo, stated, registers, reason, tmp_path):
    robot = with_servo(tmp_path, servo, stated)
    assert read(registers).set_in(robot) is robot
    (sentence,) = read(registers).describe(robot)
    assert reason in sentence


def test_registers_that_switch_off_what_a_model_lacks_are_not_mentioned(tmp_path):
    robot = with_servo(tmp_path, SERVO, "")
    off = {"d_gain": 0, "i_gain": 0, "moving_speed": 0, "punch": 0, "Acceleration": 0, "CW_Dead_Zone": 0}
    assert read(off).set_in(robot) is robot
    assert read(off).describe(robot) == ()


SPEEDS = {
    "no profile": (
        {"Profile_Velocity": 0, "Profile_Acceleration": 9},
        {"profile_velocity": 0, "profile_acceleration": 0},
    ),
    "profile": ({"Profile_Velocity": 5, "Profile_Acceleration": 9}, {"profile_velocity": 5, "profile_acceleration": 9}),
    "by time": ({"Profile_Velocity": 5, "Profile_Acceleration": 9, "Drive_Mode": 5}, {"profile_time": 5}),
    "speed mode's goal": ({"Profile_Velocity": 0, "Goal_Velocity": 77}, {"profile_velocity": 0}),
    "backwards": ({"Goal_Velocity": -77}, {"goal_velocity": 77}),
    "older name": ({"Goal_Speed": 77}, {"goal_velocity": 77}),
    "no acceleration": ({"Acceleration": 0, "Maximum_Acceleration": 50}, {"goal_acceleration": 0}),
}


@pytest.mark.parametrize(("table", "expected"), SPEEDS.values(), ids=SPEEDS)
def test_profiles_are_read_as_the_servos_use_them(table, expected):
    assert {name: values["pendulum"] for name, values in read(table).values.items()} == expected


def test_the_highest_acceleration_is_no_limit_and_the_next_is_one(tmp_path):
    given = with_servo(tmp_path, SERVO, "")
    assert read({"Acceleration": 254, "Maximum_Acceleration": 254}).set_in(given) is given
    goal = read({"Acceleration": 253}).set_in(given).spec().joint("pendulum_deadband_goal")
    assert goal.actfrcrange[1] / goal.armature == pytest.approx(25_300 * STEP)  # 39 rad/s²


def test_a_slide_gets_no_speed_of_its_servo(tmp_path):
    path = tmp_path / "slide.xml"
    path.write_text(PENDULUM.replace('type="hinge"', 'type="slide"'))
    (sentence,) = read({"Goal_Velocity": 64}).describe(find_robot(path))
    assert "travel of a slide" in sentence


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
    assert read({"p_gain": 0, "torque_limit": 0, "id": 3, "return_delay": 32}).values == {}


def test_merged_recordings_keep_their_registers():
    one, other = told(recording("command_delay:delay=0", 2), FULL), told(recording("command_delay:delay=0", 3), LOW)
    parts = [(each.origin.provenance.target, each.n_episodes) for each in (one, one, other)]
    history = join_targets(parts)["registers"]
    assert [entry["from_episode"] for entry in history] == [0, 4]
    assert history[1]["joints"]["pendulum"]["p_gain"] == 200
    unknown = join_targets([*parts, ({}, 2)])["registers"]
    assert unknown == [*history, {"from_episode": 7, "joints": {}}]
    # the same history in two recordings is one after the other
    twice = join_targets([({"registers": [{"from_episode": 0, "joints": 1}, {"from_episode": 2, "joints": 2}]}, 3)] * 2)
    assert [entry["from_episode"] for entry in twice["registers"]] == [0, 2, 3, 5]


def test_a_part_of_a_recording_has_its_own_registers_and_logs():
    target = {"kind": "log", "episodes": ["a", "b", "c"], "registers": [
        {"from_episode": 0, "joints": 1}, {"from_episode": 2, "joints": 2}]}  # fmt: skip
    part = select_episodes(target, [2, 0, 0], 3)
    assert part == {"kind": "log", "episodes": ["c", "a", "a"], "registers": [
        {"from_episode": 0, "joints": 2}, {"from_episode": 1, "joints": 1}]}  # fmt: skip
    assert join_targets([(select_episodes(target, [0, 1], 3), 2), (select_episodes(target, [2], 3), 1)]) == target


def test_registers_stay_with_their_episodes_through_split_cut_and_merge(tmp_path, monkeypatch, arm):
    monkeypatch.chdir(tmp_path)
    whole = told(recording(CHANGED["p_gain"][1], 3), FULL, LOW)  # the first episode's register is another
    root = whole.save(tmp_path / "datasets/arm")
    assert main(["split", str(root), "--episodes", "1-2", "--names", "low", "full"]) == 0
    assert main(["split", "datasets/low", "--seconds", "1", "--name", "cut"]) == 0
    assert main(["merge", "datasets/full", "datasets/low", "--name", "again"]) == 0

    def gains(dataset: Dataset) -> list[tuple[int, float]]:
        history = dataset.origin.provenance.target["registers"]
        return [(entry["from_episode"], entry["joints"]["pendulum"]["p_gain"]) for entry in history]

    assert gains(nas.Dataset.load("datasets/low")) == gains(nas.Dataset.load("datasets/cut")) == [(0, 200)]
    assert gains(nas.Dataset.load("datasets/again")) == [(0, 400), (1, 200)]
    assert gains(nas.Dataset.load(root, [2])) == gains(nas.Dataset.load(root).select([1])) == [(0, 200)]
    assert source_error(arm, nas.Dataset.load("datasets/cut")) < 1e-4


def test_films_have_the_recordings_registers_and_pairs_say_that_they_do_not(arm, tmp_path, capsys):
    """φ corrects the source that an environment has, which is the model as it is."""
    dataset = told(recording(CHANGED["p_gain"][1], 2), LOW)
    assert follow(dataset.select([1]), 1, [str(arm)]).ghosts[1].errors.max() < 1e-4
    root = dataset.save(tmp_path / "raw")
    for registers, words in ((LOW, "the position gain is multiplied by 0.5"), (FULL, "")):
        told(dataset, registers).save(tmp_path / f"raw{bool(words)}")
        (root,) = (tmp_path / f"raw{bool(words)}").glob("v*")
        assert main(["pair", str(root), "--model", str(arm), "--out", str(tmp_path / f"out{bool(words)}")]) == 0
        said = capsys.readouterr().out
        assert ("the source is paired as given" in said) == bool(words) and words in said
    paired = nas.Dataset.load(tmp_path / "outTrue")
    assert np.abs(paired.sim_states - paired.next_states).max() > 0.01
    assert nas.train_delta(paired, model=str(arm), updates=1)


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


def powered(dataset: Dataset, volts: float) -> Dataset:
    """Return a recording whose servo measured a voltage; readings of 0 V are none, and those without torque idle."""
    column, torque = np.full((dataset.n_frames, 1), volts, np.float32), np.ones((dataset.n_frames, 1), np.float32)
    column[::3], column[1::7], torque[1::7] = 0, 30, 0
    with_volts = dataset.with_column("nas.voltage", Feature(("pendulum.voltage",), ("V",)), column)
    return with_volts.with_column("nas.torque_enable", Feature(("pendulum.torque_enable",)), torque)


def test_a_measured_voltage_scales_gain_and_torque_limit_of_a_model_that_states_its_own(tmp_path):
    plain, stated = find_robot("pendulum"), tmp_path / "arm.xml"
    stated.write_text(
        PENDULUM.replace("<actuator>", '<custom><numeric name="supply_voltage" data="7.4"/></custom><actuator>')
    )
    weak = positions(plain, parse("servo_stiffness:joint=pendulum,factor=0.25"),
                     parse("torque_limit:joint=pendulum,torque=0.1781"))  # fmt: skip
    assert np.abs(positions(plain) - weak).max() > 0.03
    registers = ServoRegisters.of(powered(recording("command_delay:delay=0", 1), 1.85))
    assert registers.values == {"supply_voltage": {"pendulum": 1.85}}
    robot = find_robot(stated)
    assert positions(registers.set_in(robot)) == pytest.approx(weak, abs=1e-6)
    (sentence,) = registers.describe(robot)
    assert "torque per duty is multiplied by 0.25 (supply_voltage 1.85, in the model 7.4)" in sentence
    assert registers.list_changes(registers.set_in(robot)) == []

    # usual models state no voltage: nothing to say, and nothing changes
    assert registers.describe(plain) == ()
    assert positions(registers.set_in(plain)) == pytest.approx(positions(plain), abs=1e-12)


@pytest.mark.parametrize(
    ("unit", "reading", "volts"), [("V", 6.0, 6.0), ("mV", 6000, 6.0), ("0.1 V", 60, None), ("", 6, None)]
)
def test_voltages_are_used_in_volts_and_millivolts_for_one_servo_or_all(unit, reading, volts):
    dataset = recording("command_delay:delay=0", 1)
    column = np.full((dataset.n_frames, 1), reading, np.float32)
    measured = dataset.with_column("nas.voltage", Feature(("voltage",), (unit,) if unit else ()), column)
    expected = {} if volts is None else {"supply_voltage": {"pendulum": volts}}
    assert ServoRegisters.of(measured).values == expected


def test_each_episode_is_evaluated_with_its_own_registers(arm):
    whole, half = recording("command_delay:delay=0", 2), recording(CHANGED["p_gain"][1], 2)
    parts = [np.concatenate([one.states, one.next_states[-1:]])[:, :1] for one in (whole.select([0]), half.select([1]))]
    commands = [one.commands for one in (whole.select([0]), half.select([1]))]
    both = Dataset.from_arrays(parts, commands, rate=50, joints=["pendulum"])
    found = nas.evaluate(arm, told(both, FULL, LOW), plain_fit=False)
    assert max(found.open_loop["source"].per_episode) < 0.01
    assert any(note.startswith("Episode 1: ") and "multiplied by 0.5" in note for note in found.notes)
    assert found.to_json()["notes"] == list(found.notes)
    errors = nas.evaluate(arm, told(both, FULL), plain_fit=False).open_loop["source"].per_episode
    assert errors[1] > 0.02


def test_registers_of_a_report_stand_where_the_recording_has_none(arm):
    known = ServoRegisters({"p_gain": {"pendulum": 200.0}})
    assert read({"torque_limit": 500}).over(known).values == {
        "p_gain": {"pendulum": 200.0},
        "torque_limit": {"pendulum": 500.0},
    }
    assert read(FULL).over(known).values["p_gain"] == {"pendulum": 400.0}
    assert "p_gain" not in read(FULL, LOW).over(known).values


def test_only_position_servos_have_gains_and_supplies(tmp_path):
    speed = tmp_path / "speed.xml"
    speed.write_text(
        """<mujoco><custom><numeric name="p_gain" data="400"/><numeric name="supply_voltage" data="7.4"/></custom>
        <worldbody><body><joint name="pendulum" axis="0 1 0"/><geom size="0.05" mass="1"/></body></worldbody>
        <actuator><velocity joint="pendulum" kv="4"/></actuator></mujoco>"""
    )
    robot = find_robot(speed)
    registers = ServoRegisters({"p_gain": {"pendulum": 200.0}, "supply_voltage": {"pendulum": 6.0}})
    assert np.array_equal(compiled(registers.set_in(robot)).actuator_gainprm, compiled(robot).actuator_gainprm)
    told_of = " ".join(registers.describe(robot))
    assert "p_gain is not used in pendulum, because the model's servo has no position gain" in told_of
    assert "supply_voltage is not used in pendulum" in told_of


def test_registers_are_set_in_pybullet_too(arm):
    dataset = recording(CHANGED["p_gain"][1], 2)
    errors = [
        nas.evaluate(arm, told(dataset, registers), engine="bullet", plain_fit=False).open_loop["source"].overall
        for registers in (LOW, FULL)
    ]
    assert errors[0] < 0.3 * errors[1]


def test_an_ablation_tells_which_registers_its_source_lacks(arm, tmp_path):
    root = told(recording("command_delay:delay=0", 2), LOW).save(tmp_path / "data")
    (change,) = SweepData(root, None, str(arm)).list_register_changes()
    assert change.startswith("the position gain is multiplied by 0.5")
    assert SweepData(root, None, "pendulum").list_register_changes() == []
    assert SweepData(root).list_register_changes() == []
