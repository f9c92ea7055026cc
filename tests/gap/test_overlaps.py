"""Contacts of the model that the recording contradicts: told, and left out of the search and of the written model."""

import json
from pathlib import Path

import mujoco
import pytest
from support.two_joint_arm import ARM, recorded

from nas_data.cli import main
from nas_data.effects.base import parse
from nas_data.gap import workflow
from nas_data.gap.overlaps import find_overlaps
from nas_data.gap.problem import Problem

SOLID = ARM.replace('contype="0" conaffinity="0"', "")
FLOOR = '<geom name="table" type="plane" pos="0 0 {height}" size="1 1 0.1"/>\n    <body name="upper"'
DAMPING = "viscous_friction:joint=elbow,coefficient=0.03"


def with_table(folder: Path, height: float, extra: str = "") -> Path:
    text = SOLID.replace('<body name="upper"', FLOOR.format(height=height)).replace("<actuator>", extra + "<actuator>")
    path = folder / f"table{height}{len(extra)}.xml"
    path.write_text(text)
    return path


@pytest.fixture(scope="module")
def free(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("free") / "arm.xml"
    path.write_text(ARM)
    return path


@pytest.fixture(scope="module")
def recording(free: Path) -> Path:
    """What an arm that touches nothing did, with more damping than its model."""
    return recorded(free, free.parent / "data", "--effect", DAMPING)


def test_a_table_that_is_not_there_is_told_and_left_out_of_the_written_model(
    recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    given = (str(recording), "--model", str(with_table(tmp_path, 0.25)))
    capsys.readouterr()
    assert main(["gap", "find", *given, "--out", str(tmp_path), "--json"]) == 0
    told = {check["check"]: check for check in json.loads(capsys.readouterr().out)["audit"]}["contacts"]
    assert not told["ok"]
    assert "'table' and 'lower'" in told["finding"]
    (effects := tmp_path / "effects.json").write_text(json.dumps([parse(DAMPING).to_json()]))
    assert main(["gap", "add", *given, "--effects", str(effects), "--out", str(tmp_path / "added")]) == 0
    written = mujoco.MjModel.from_xml_path(str(tmp_path / "added" / "model.xml"))
    assert written.nexclude >= 1


@pytest.mark.slow
def test_a_table_that_is_not_there_is_told_and_does_not_bend_the_names(
    recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Pictures and the next experiment, which are nothing to a table, are left out."""
    monkeypatch.setattr(workflow, "show", lambda *_: None)
    monkeypatch.setattr(workflow, "propose_experiment", lambda *_: workflow.Proposal())
    model = with_table(tmp_path, 0.25)
    report = workflow.investigate(recording, model, tmp_path / "report")
    told = {check.check: check for check in report.find.audit}["contacts"]
    assert not told.ok
    assert "'table' and 'lower'" in told.finding
    assert [(effect.name, effect.joint) for effect in report.effects] == [("viscous_friction", "elbow")]
    assert report.effects[0].parameters["coefficient"].value == pytest.approx(0.03, rel=0.1)
    assert report.verdict == "explained"
    assert report.gap.before > 10 * report.gap.after, "before is the model as handed over, with its table"
    assert "+" in {
        line[0] for line in (tmp_path / "report" / "model.diff").read_text().splitlines() if "<exclude" in line
    }
    written = mujoco.MjModel.from_xml_path(str(tmp_path / "report" / "model.xml"))
    assert written.nexclude >= 1


def test_an_arm_that_lies_on_its_table_contradicts_nothing(tmp_path: Path):
    model = with_table(tmp_path, 0.27)
    problem = Problem.load(recorded(model, tmp_path / "data"), model)
    assert not find_overlaps(problem.as_given, problem.dataset)
    assert problem.train.nominal is problem.as_given


def test_contact_pairs_that_the_model_lists_are_left_out_too(recording: Path, tmp_path: Path):
    forearm = SOLID.replace('<geom fromto="0 0 0 0.07 0 0"', '<geom name="forearm" fromto="0 0 0 0.07 0 0"')
    path = tmp_path / "pair.xml"
    path.write_text(
        forearm.replace('<body name="upper"', FLOOR.format(height=0.25)).replace(
            "<actuator>", '<contact><pair geom1="table" geom2="forearm"/></contact><actuator>'
        )
    )
    problem = Problem.load(recording, path)
    assert find_overlaps(problem.as_given, problem.dataset)
    assert not find_overlaps(problem.train.nominal, problem.dataset)
    assert problem.as_given.simulator().model.npair == 1
    assert not problem.train.nominal.simulator().model.npair
