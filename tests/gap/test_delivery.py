"""The model that a report delivers: it loads anywhere in plain MuJoCo and keeps what the author put into it."""

import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import mujoco
import pytest
from support.delivery_samples import PARTS, arm, delivered, nominal
from support.two_joint_arm import ARM, recorded

from nas_data.effects.base import Effect, make_effect
from nas_data.errors import ModelFileError
from nas_data.gap.compose import measure_gap
from nas_data.gap.problem import Problem
from nas_data.gap.score_model import lengthen_timestep, predict_held, score_model
from nas_data.gap.search.final import FinalFit
from nas_data.gap.write_model import write_model
from nas_data.mjcf.export import check_portable, write_portable
from nas_data.robots.base import find_robot


@pytest.mark.parametrize("kind", PARTS)
def test_a_model_with_files_loads_wherever_the_report_is_moved(kind: str, tmp_path: Path):
    path = arm(tmp_path / "given", kind)
    before = mujoco.MjModel.from_xml_path(str(path))
    given = nominal(path)
    delivered(tmp_path, given, make_effect("backlash", "j2", {"half_width": 0.02}))
    shutil.rmtree(tmp_path / "given")
    after = mujoco.MjModel.from_xml_path(str(tmp_path / "moved/model.xml"))
    for field in ("body_mass", "body_inertia", "mesh_vert", "hfield_data", "tex_data"):
        assert getattr(after, field) == pytest.approx(getattr(before, field), rel=1e-5)
    assert str(tmp_path) not in (tmp_path / "moved/model.xml").read_text()


def test_a_report_written_again_needs_no_more_files(tmp_path: Path):
    given = nominal(arm(tmp_path / "given", "attached"))
    (tmp_path / "assets").mkdir()
    (tmp_path / "assets/link.stl").write_text("somebody else's")
    for _ in range(2):
        write_model(tmp_path, given, (), {})
    assert sorted(file.name for file in (tmp_path / "assets").iterdir()) == ["link.stl", "link1.stl", "link2.stl"]
    assert (tmp_path / "assets/link.stl").read_text() == "somebody else's"


def test_files_that_cannot_be_found_are_left_out_where_nothing_touches(tmp_path: Path):
    given = nominal(arm(tmp_path / "given", "mesh", geom='contype="0" conaffinity="0"'))
    write_portable(given.make_spec({}), tmp_path / "elsewhere/arm.xml", tmp_path / "model.xml")
    after = mujoco.MjModel.from_xml_path(str(tmp_path / "model.xml"))
    assert after.nmesh == 0
    before = given.spec.copy().compile()
    assert after.body_mass == pytest.approx(before.body_mass, rel=1e-5)
    assert after.body_inertia == pytest.approx(before.body_inertia, rel=1e-5)


def test_a_model_that_cannot_be_written_is_refused_before_the_search(tmp_path: Path, monkeypatch, capsys):
    from nas_data.cli import main

    path = arm(tmp_path / "given")
    with pytest.raises(ModelFileError, match=r"arm\.xml cannot be written as a model of its own"):
        check_portable(nominal(path).spec, tmp_path / "elsewhere/arm.xml")
    data = recorded(path, tmp_path / "data", "--episodes", "2")
    monkeypatch.setattr("nas_data.mjcf.export.find_file", lambda *given: None)
    capsys.readouterr()
    assert main(["gap", str(data), "--model", str(path), "--out", str(tmp_path / "out")]) == 2
    told = capsys.readouterr().err
    assert "cannot be written as a model of its own" in told and "find:" not in told
    assert not (tmp_path / "out").exists()


EFFECTS = (
    make_effect("backlash", "j1", {"half_width": 0.02}),
    make_effect("deadband", "j2", {"half_width": 0.02}),
    make_effect("speed_limit", "j1", {"speed": 3.0}),
)


@pytest.mark.parametrize("effects", [(), EFFECTS[:1], EFFECTS[1:2], EFFECTS])
def test_keyframes_keep_their_numbers_with_their_joints(effects: Sequence[Effect], tmp_path: Path):
    key = '<keyframe><key name="home" qpos="1 2 3 1 0 0 0 0.3 0.4" qvel="0 0 0 0 0 0 5 6" ctrl="0.7 0.8"/></keyframe>'
    puck = '<body name="puck"><freejoint/><geom size="0.1"/></body>'
    model = delivered(tmp_path, nominal(arm(tmp_path / "given", keyframes=key, world=puck)), *effects)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    assert data.qpos[:7] == pytest.approx([1, 2, 3, 1, 0, 0, 0])
    assert [data.sensor(f"{joint}.pos").data[0] for joint in ("j1", "j2")] == pytest.approx([0.3, 0.4])
    assert [data.joint(joint).qvel[0] for joint in ("j1", "j2")] == pytest.approx([5, 6])
    assert data.ctrl == pytest.approx([0.7, 0.8])
    assert data.act == pytest.approx([0.7] if effects is EFFECTS else [])
    torque = data.qfrc_actuator[[model.joint(joint).dofadr[0] for joint in ("j1", "j2")]]
    assert torque[0] == pytest.approx(5 * (0.7 - 0.3))


@pytest.mark.parametrize("ending", [".mjcf", ""])
@pytest.mark.parametrize("kind", PARTS)
def test_a_model_whose_name_has_another_ending_is_read_and_delivered(kind: str, ending: str, tmp_path: Path):
    path = arm(tmp_path / "given", kind)
    usual = mujoco.MjModel.from_xml_path(str(path))
    named = path.rename(path.with_suffix(ending))
    after = delivered(tmp_path, nominal(named))
    assert after.mesh_vert == pytest.approx(usual.mesh_vert, rel=1e-5)
    assert sorted(file.name for file in named.parent.iterdir() if file.is_file()) == [named.name]


def test_a_folder_is_answered_with_a_model_in_it(tmp_path: Path, monkeypatch):
    path = arm(tmp_path / "arm.v2")
    with pytest.raises(ModelFileError, match=r"arm\.v2 is a folder; give a model file in it, such as .*arm\.xml\."):
        find_robot(path.parent)
    (tmp_path / "empty").mkdir()
    with pytest.raises(ModelFileError, match=r"empty is a folder; give a model file\."):
        find_robot(tmp_path / "empty")
    (tmp_path / "ergojr").mkdir()
    monkeypatch.chdir(tmp_path)
    assert find_robot("ergojr").name == "ergojr"


def test_a_plain_fit_that_diverges_on_held_out_episodes_ends_no_report(tmp_path: Path):
    (tmp_path / "arm.xml").write_text(ARM)
    problem = Problem.load(recorded(tmp_path / "arm.xml", tmp_path / "data", "--episodes", "2"), tmp_path / "arm.xml")
    given, wild = FinalFit((), {}, ()), FinalFit((), {"elbow.damping": -1e4}, ())
    assert not predict_held(problem, wild).is_finite
    outcome = score_model(problem, given, given, wild, tmp_path)
    gap = measure_gap(problem.held, outcome)
    assert gap.plain is None and gap.per_joint["elbow"].plain is None
    assert gap.after == pytest.approx(gap.before)
    with pytest.raises(ModelFileError, match="diverges in MuJoCo on a held-out episode"):
        measure_gap(problem.held, replace(outcome, after=outcome.plain))
    assert lengthen_timestep(problem, wild, problem.held.nominal) is problem.held.nominal
