"""A slide's metres stay metres from the map or the model to the tables, and never enter a mean with radians."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from support.dataset_samples import recorded
from support.import_samples import columns_of, map_text, motion, sample_map, write_log

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import ACTION, STATE, make_position_feature, make_state_feature
from nas_data.dataset.transitions import as_transitions
from nas_data.effects.base import parse
from nas_data.errors import DatasetInvalid, JointMismatch
from nas_data.gap.deliver import Delivery
from nas_data.gap.score_model import Prediction
from nas_data.joint_units import average_by_kind, convert_hinge_unit, find_display_unit, format_table_unit
from nas_data.metrics import Errors, format_error_table
from nas_data.pairing import pair
from nas_data.recorders.logs import import_logs
from nas_data.reports.run_sections import make_models_section
from nas_data.reports.runs import ModelRun
from nas_data.robots.base import find_robot
from nas_data.simulators.against_model import check
from nas_data.simulators.mujoco import MujocoSimulator

ARM = """<mujoco><compiler angle="radian" autolimits="true"/><option timestep="0.002" integrator="implicitfast"/>
<worldbody><body pos="0 0 .5"><joint name="j" axis="0 1 0" damping=".05" armature=".002"/>
<geom type="capsule" fromto="0 0 0 .15 0 0" size=".01" mass=".05" contype="0" conaffinity="0"/><body pos=".15 0 0">
<joint name="g" type="slide" axis="0 1 0" damping="2" armature=".05"/>
<geom type="box" size=".02 .005 .01" mass=".03" contype="0" conaffinity="0"/></body></body></worldbody>
<actuator><position joint="j" kp="20" kv=".3"/><position joint="g" kp="200" kv="5"/></actuator></mujoco>"""


@pytest.fixture
def simulator(tmp_path) -> MujocoSimulator:
    path = tmp_path / "arm.xml"
    path.write_text(ARM)
    return MujocoSimulator(find_robot(path), 0.02)


def lerobot(units: tuple[str, ...]) -> Dataset:
    """A recording with LeRobot's keys alone: positions and commands of a hinge and a slide."""
    whole = recorded(joints=("j", "g"))
    places = make_position_feature(("j", "g"))
    features = {STATE: replace(places, units=units), ACTION: replace(places, units=units)}
    columns = {STATE: whole.columns[STATE][:, :2], ACTION: whole.columns[ACTION]}
    return Dataset(features, columns, whole.lengths, 50.0)


def test_metres_with_lerobots_keys_are_taken():
    dataset, _ = as_transitions(lerobot(("rad", "m")))
    assert dataset.features[STATE] == make_state_feature(("j", "g"), ("g",))
    assert dataset.features[STATE].units == ("rad", "m", "rad/s", "m/s")
    assert dataset.slides == {"g"}


def test_millimetres_in_a_dataset_are_answered_with_what_is_known():
    with pytest.raises(DatasetInvalid, match="joint g is in mm, rad is needed, or m for a slide"):
        as_transitions(lerobot(("rad", "mm")))


@pytest.mark.parametrize("units", [(), ("rad", "rad"), ("rad", "m")])
def test_where_a_model_is_at_hand_it_tells_slides_from_hinges(simulator, units):
    paired = pair(as_transitions(lerobot(units))[0], simulator)
    assert simulator.slides == ("g",)
    assert all(paired.features[key].units[1] == "m" for key in (STATE, ACTION, "next.observation.sim_state"))


def test_metres_of_a_hinge_are_refused(simulator):
    with pytest.raises(JointMismatch, match="has j in metres, but the model's j is a hinge"):
        pair(as_transitions(lerobot(("m", "m")))[0], simulator)


@pytest.mark.parametrize(("unit", "metres"), [("m", 1.0), ("cm", 1e-2), ("mm", 1e-3)])
def test_a_map_takes_lengths(tmp_path, unit, metres):
    wave = motion()
    wave = wave.edited(position=wave.position / [1, 100 * metres], command=wave.command / [1, 100 * metres])
    log = write_log(tmp_path / "log.npz", columns_of(wave))
    extra = f'[read.position.joints.elbow]\nunit = "{unit}"\n[read.command.joints.elbow]\nunit = "{unit}"\n'
    register = f'column = "dq"\nunit = "rad/s"\n[read.velocity.joints.elbow]\nunit = "{unit}/s"'
    assert extra in map_text(extra=extra)
    found = import_logs([log], sample_map(tmp_path, extra=extra, velocity='"derive"', register=register)).dataset
    assert found.features[STATE].units == ("rad", "m", "rad/s", "m/s")
    np.testing.assert_allclose(found.states[:, 1], motion().position[:-1, 1] / 100, atol=1e-6)


def test_a_table_never_averages_both_kinds():
    squared = np.array([[np.radians(2.0) ** 2, 0.003**2]])
    errors = Errors(("j", "g"), squared, np.array([10]), frozenset({"g"}))
    assert errors.overall == pytest.approx(np.radians(2.0))
    assert errors.to_json()["overall_slides"] == pytest.approx(0.003)
    text = format_error_table({"source": errors}, "Errors")
    assert "[deg; g mm]" in text and "hinges" in text and "slides" in text
    assert [float(word) for word in text.splitlines()[-1].split()[1:]] == [2.0, 3.0, 2.0, 3.0, 2.0]
    assert format_table_unit(("g",), ("g",)) == "mm"


@pytest.mark.parametrize(
    ("unit", "there"), [("rad", "m"), ("N·m", "N"), ("N·m·s/rad", "N·s/m"), ("kg·m²", "kg"), ("s", "s"), ("", "")]
)
def test_an_effects_unit_is_that_of_its_joint(unit, there):
    assert convert_hinge_unit(unit, slide=True) == there and convert_hinge_unit(unit, slide=False) == unit


def test_an_effects_file_says_metres_at_a_slide():
    effect = parse("backlash:joint=g,half_width=0.002")
    assert effect.to_json(("g",))["parameters"]["half_width"]["unit"] == "m"
    assert effect.to_json()["parameters"]["half_width"]["unit"] == "rad"


@pytest.mark.parametrize(("zero", "checks"), [(0.0, set()), (0.03, {"model_limits"})])
def test_a_slide_that_is_centimetres_beyond_its_range_is_reported(tmp_path, zero, checks):
    path = tmp_path / "arm.xml"
    path.write_text(ARM.replace('type="slide"', 'type="slide" range="-0.02 0.02"'))
    dataset, _ = as_transitions(lerobot(("rad", "m")))
    states = dataset.states * [1, 0.02 / np.abs(dataset.states[:, 1]).max(), 1, 1] + [0, zero, 0, 0]
    found = check(replace(dataset, columns={**dataset.columns, STATE: states}), path)
    assert {finding.check for finding in found} == checks


def test_a_slide_that_a_map_reads_as_an_angle_is_reported_and_the_remedy_works(tmp_path):
    (tmp_path / "arm.xml").write_text(ARM)
    angles = recorded(joints=("j", "g"))
    (finding,) = check(angles, tmp_path / "arm.xml")
    assert finding.message == (
        "g was read as an angle, but is a slide in the model; give it a length for a unit in the map (m, cm, mm), or "
        "name it in 'slides' if its unit is 'normalised'."
    )
    features = {**angles.features, STATE: make_state_feature(("j", "g"), ("g",))}
    assert check(replace(angles, features=features), tmp_path / "arm.xml") == []


def test_a_choice_among_models_is_not_the_hinges_alone():
    floor, slides = np.array([1e-3, 2e-3, 1e-5]), ("g",)
    scales = average_by_kind(floor, ("j", "k", "g"), slides)
    np.testing.assert_allclose(scales, [1.5e-3, 1.5e-3, 1e-5])
    good_slide, good_hinges = np.array([[3e-3, 3e-3, 1e-5]]) ** 2, np.array([[2e-3, 2e-3, 5e-3]]) ** 2
    one, other = (Prediction(np.empty(0), squares) for squares in (good_slide, good_hinges))
    held = SimpleNamespace(
        mean_floor=floor, evidence=SimpleNamespace(joints=("j", "k", "g")), nominal=SimpleNamespace(slides=slides)
    )
    choice = Delivery(SimpleNamespace(held=held), None, Path(), None)
    assert choice.rms(one) < choice.rms(other)
    hinges = average_by_kind(floor, ("j", "k", "g"), ())
    np.testing.assert_allclose(hinges, floor.mean())  # among joints of one kind the ranking is that of plain errors


@pytest.mark.parametrize(("si", "cell"), [("rad", "5.730°"), ("m", "100.000 mm"), ("1", "10.000 %"), (None, "0.100")])
def test_a_trainings_error_is_shown_in_its_unit(si, cell):
    unit = None if si is None else find_display_unit(si)
    rows = [{"update": 0.0, "validation": 0.1, "seconds": 1.0}]
    section = make_models_section([ModelRun(Path("phi"), "delta", "arm", "0" * 64, unit, rows)])
    assert section.blocks[1].rows[0][1] == cell
    assert section.blocks[1].rows[0][1].split()[-1].strip("0123456789.") in section.blocks[0].caption
