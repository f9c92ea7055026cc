"""Grading of blind cases: the right answer is right, every kind of wrong one is seen to be wrong."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from support.blind_samples import answered, entry_of, know_everything, know_nothing, report_of, shorten

from nas_data.benchmarks.blind.benchmark import BlindPlan, run
from nas_data.benchmarks.blind.fresh import Delivered
from nas_data.benchmarks.blind.grade import ConfidenceGrade, grade_names
from nas_data.benchmarks.blind.record import CaseRecord
from nas_data.benchmarks.blind.run_case import hash_case_code
from nas_data.benchmarks.blind.tables import compute_reliability, make_tables, print_tables
from nas_data.cli import main
from nas_data.errors import DatasetInvalid, ModelFileError, OutputExists, UnknownName
from nas_data.runs.environment_info import find_commit

HIDDEN = [
    {"effect": "backlash", "joint": "m3", "parameters": {"half_width": 0.02}, "mark": 5.0, "marked_joint": "m3"},
    {"effect": "payload", "joint": None, "parameters": {"mass": 0.05}, "mark": 9.0, "marked_joint": "m2"},
]
ANSWER = answered(HIDDEN, family="two")
RIGHT = [entry_of("payload", None, {"mass": 0.055}), entry_of("backlash", "m3", {"half_width": 0.02})]


def grade(effects, verdict="explained", answer=ANSWER, unexplained=None):
    return grade_names(answer, report_of(effects, verdict, unexplained))


def test_the_right_names_in_any_order_are_exact():
    found = grade(RIGHT)
    assert found.exact and not found.confident_wrong and found.verdict_right
    errors = {row.parameter: row.relative_error for row in found.parameters}
    assert errors == {"half_width": 0.0, "mass": pytest.approx(0.1)}
    assert all(row.covered for row in found.parameters)


def test_a_gain_is_relative_to_the_model_handed_over_not_to_the_plant():
    """The plant's own gain is 8 % low, the hidden factor doubles it: a report can only say 1.84."""
    ones = [1.0, 1.0]
    answer = answered(
        [{"effect": "servo_stiffness", "joint": "m2", "parameters": {"factor": 2.0}}],
        joints=["m1", "m2"],
        base={"mass": ones, "damping": ones, "armature": ones, "stiffness": [1.0, 0.92]},
    )
    found = grade([entry_of("servo_stiffness", "m2", {"factor": 1.84})], answer=answer)
    assert found.parameters[0].relative_error == pytest.approx(0.0)


def test_one_effect_of_the_whole_arm_stands_for_one_in_every_joint():
    def hidden(joint, torque):
        parameters = {"torque": torque}
        return {"effect": "coulomb_friction", "joint": joint, "parameters": parameters}

    effects = [hidden("m1", 0.1), hidden("m2", 0.125)]
    answer = answered(effects, family="every", joints=["m1", "m2"])
    whole = entry_of("coulomb_friction", None, {"torque": 0.1})
    found = grade([whole], answer=answer)
    assert found.exact and found.verdict_right and found.named == (("coulomb_friction", None),)
    assert [row.relative_error for row in found.parameters] == pytest.approx([0.0, 0.2])
    assert found.confidences == (ConfidenceGrade(0.95, True),)
    each = [entry_of("coulomb_friction", joint, {"torque": 0.1}) for joint in answer.joints]
    assert grade(each, answer=answer).exact
    assert not grade(each[:1], answer=answer).exact
    assert not grade([whole, each[0]], answer=answer).exact  # the same joint twice
    assert not grade([whole], answer=replace(answer, joints=("m1", "m2", "m3"))).exact  # the third has none
    assert not grade([entry_of("viscous_friction", None, {"coefficient": 0.1})], answer=answer).exact


def test_the_right_effect_in_a_wrong_joint_is_confidently_wrong():
    found = grade([RIGHT[0], entry_of("backlash", "m4", {"half_width": 0.02})])
    assert not found.exact and found.confident_wrong
    assert found.wrong_joint == (("backlash", "m4"),)


def test_a_wrong_name_with_a_doubt_is_not_confidently_wrong():
    found = grade([*RIGHT, entry_of("deadband", "m1", {"half_width": 0.1}, confidence=0.6)])
    assert not found.exact and not found.confident_wrong
    assert found.extra == (("deadband", "m1"),)


def test_a_true_effect_listed_beside_a_wrong_one_is_seen():
    found = grade([RIGHT[0], entry_of("coulomb_friction", "m3", {"torque": 0.1}, beside=["backlash"])])
    assert found.listed_beside == (("backlash", "m3"),)
    assert found.confident_wrong and not found.confident_wrong_without_the_true_one_beside


def test_saying_nothing_is_an_abstention():
    found = grade([], "unexplained")
    assert found.abstained and not found.confident_wrong and len(found.missing) == 2


def test_outside_the_catalogue_every_name_is_wrong_and_the_joint_is_wanted():
    answer = answered([{**HIDDEN[0], "effect": "cogging"}], family="outside")
    named = grade([RIGHT[1]], "explained", answer)
    assert named.confident_wrong and not named.exact and not named.unexplained_joint_named
    honest = grade([], "unexplained", answer, [{"joint": "m3", "ratio_to_noise": 4.0, "goes_with": "position"}])
    assert honest.exact and honest.verdict_right and honest.unexplained_joint_named


@pytest.mark.parametrize("report", [{}, {"effects": 3}, {"effects": [{"effect": "payload"}]}])
def test_a_report_of_another_form_is_refused(report):
    with pytest.raises(DatasetInvalid, match="structure"):
        grade_names(ANSWER, report)


def test_confidence_is_compared_with_what_was_right():
    rows = compute_reliability([ConfidenceGrade(0.95, True), ConfidenceGrade(0.96, False)])
    assert rows == [{"from": 0.95, "to": 0.99, "findings": 2, "confidence": pytest.approx(0.955), "right": 0.5}]


def test_a_delivered_model_without_its_sensors_is_refused(tmp_path):
    file = tmp_path / "model.xml"
    file.write_text("<mujoco/>")
    with pytest.raises(ModelFileError, match="has no 'm1'"):
        Delivered.load(file, ["m1"], ["m1"], 100.0)


@pytest.fixture
def small(monkeypatch):
    shorten(monkeypatch)


def test_who_knows_everything_is_right_and_leaves_little(small, tmp_path):
    plan = BlindPlan(("one", "two"), ("mujoco",), 1, 4)
    records = run(plan, tmp_path, know_everything, lambda line: None)
    assert all(record.outcome.grade.exact for record in records), records
    for record in records:
        assert record.outcome.fresh.after < 3 * record.outcome.fresh.floor < record.outcome.fresh.before


def test_who_says_nothing_is_right_only_where_nothing_hides(small, tmp_path):
    records = run(BlindPlan(("none", "one"), ("mujoco",), 1, 0), tmp_path, know_nothing, lambda line: None)
    assert [record.outcome.grade.exact for record in records] == [True, False]
    assert records[1].outcome.fresh.after == records[1].outcome.fresh.before
    assert "abstained" in print_tables(make_tables(records))


def test_a_finished_case_is_never_done_again(small, tmp_path):
    plan = BlindPlan(("none",), ("mujoco",), 2, 0)
    said: list[str] = []
    first = run(plan, tmp_path, know_nothing, said.append)
    (tmp_path / "results" / "none-mujoco-0-0001.json").unlink()
    again = run(plan, tmp_path, know_nothing, said.append)
    assert len(said) == 3
    assert [record.case for record in again] == [record.case for record in first]
    assert not list(tmp_path.rglob("dataset"))


def test_a_record_names_the_code_that_decided_it(small, tmp_path, edited):
    plan = BlindPlan(("none",), ("mujoco",), 1, 0)
    (record,) = run(plan, tmp_path, know_nothing, lambda line: None)
    assert record.commit == find_commit() and len(record.code) == 64
    (identity,) = plan.identities()
    for module, old in (
        ("nas_data.gap.workflow", "def investigate"),  # what names
        ("nas_data.effects.deadband", "half_width"),  # what may be named
        ("nas_data.benchmarks.blind.grade", "CONFIDENT = 0.8"),  # what grades
        ("nas_data.benchmarks.blind.settings.xl320", "RATE = 100.0"),  # what is drawn
        ("nas_data.benchmarks.blind.plants.mujoco_plant", "def multiply"),  # what moves
    ):
        edited(module, old, f"{old}1")
        assert hash_case_code(identity) != record.code, module


def test_cases_that_other_code_judged_are_refused_and_left_alone(small, tmp_path, edited):
    plan = BlindPlan(("none", "one"), ("mujoco",), 1, 0)
    run(plan, tmp_path, know_nothing, lambda line: None)
    before = {path: path.read_bytes() for path in (tmp_path / "results").glob("*.json")}
    edited("nas_data.benchmarks.blind.grade", "CONFIDENT = 0.8", "CONFIDENT = 0.9")
    more = BlindPlan(("none", "one"), ("mujoco",), 2, 0)
    with pytest.raises(
        OutputExists, match=r"holds 2 cases graded by another version of nas_data .* choose another --out"
    ):
        run(more, tmp_path, know_nothing, lambda line: None)
    assert {path: path.read_bytes() for path in (tmp_path / "results").glob("*.json")} == before
    assert len(run(more, tmp_path / "other", know_nothing, lambda line: None)) == 4, "the remedy works"


def test_a_record_that_names_no_code_is_refused(small, tmp_path):
    plan = BlindPlan(("none",), ("mujoco",), 1, 0)
    run(plan, tmp_path, know_nothing, lambda line: None)
    path = tmp_path / "results" / "none-mujoco-0-0000.json"
    content = json.loads(path.read_text())
    del content["code"], content["commit"]
    path.write_text(json.dumps(content))
    with pytest.raises(OutputExists, match=r"holds 1 case graded by another version of nas_data \(commit unknown\)"):
        run(plan, tmp_path, know_nothing, lambda line: None)
    shutil.rmtree(tmp_path / "results")
    assert len(run(plan, tmp_path, know_nothing, lambda line: None)) == 1, "the remedy works"


def test_a_baseline_of_other_code_is_refused_too(small, tmp_path, edited):
    plan = BlindPlan(("none",), ("mujoco",), 1, 0, baselines=("one_step",))
    (record,) = run(plan, tmp_path, know_nothing, lambda line: None)
    assert len(record.baselines["one_step"].code) == 64
    edited("nas_data.benchmarks.blind.baselines.one_step", "LEAST = 0.02", "LEAST = 0.03")
    with pytest.raises(OutputExists, match="another version of nas_data"):
        run(plan, tmp_path, know_nothing, lambda line: None)


def test_a_workflow_that_fails_is_a_fault_and_the_benchmark_goes_on(small, tmp_path):
    def break_down(dataset, model, out):
        raise ArithmeticError("no idea")

    records = run(BlindPlan(("none",), ("mujoco",), 2, 0), tmp_path, break_down, lambda line: None)
    assert [record.outcome.verdict for record in records] == ["failed", "failed"]
    assert "no idea" in records[0].outcome.fault
    assert make_tables(records)["families"][0]["failed"] == 2


def test_words_that_mean_nothing_are_refused_before_any_work(tmp_path):
    with pytest.raises(UnknownName, match="baseline"):
        run(BlindPlan(("none",), ("mujoco",), 1, 0, baselines=("guess",)), tmp_path, know_nothing, print)
    assert main(["benchmark", "gap", "--families", "four", "--out", str(tmp_path)]) == 2


def test_the_noise_floor_is_that_of_the_readings(small, tmp_path):
    record = run(BlindPlan(("none",), ("mujoco",), 1, 0), tmp_path, know_nothing, lambda line: None)[0]
    assert 0.08 < np.degrees(record.outcome.fresh.floor) < 0.12
    assert CaseRecord.read(tmp_path / "results" / "none-mujoco-0-0000.json") == record


def test_a_file_of_another_form_is_refused_and_left_alone(tmp_path):
    path = tmp_path / "results" / "none-mujoco-0-0000.json"
    path.parent.mkdir()
    path.write_text('{"case": "none-mujoco-0-0000"}')
    with pytest.raises(OutputExists, match="is not a record of a finished case"):
        run(BlindPlan(("none",), ("mujoco",), 1, 0), tmp_path, know_nothing, lambda line: None)
    assert path.read_text() == '{"case": "none-mujoco-0-0000"}'
