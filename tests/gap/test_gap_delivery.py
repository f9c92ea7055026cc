"""The model that a report delivers: it loads anywhere in plain MuJoCo and keeps what the author put into it."""

import shutil
import struct
from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np
import pytest

from nas_data.effects.base import Effect, make_effect
from nas_data.errors import ModelFileError
from nas_data.gap.episode_batch import EpisodeBatch
from nas_data.gap.export import check_portable, write_portable
from nas_data.gap.nominal import Nominal
from nas_data.gap.write_model import write_model
from nas_data.robots.base import find_robot

ARM = """
<mujoco>
  <compiler angle="radian" {folders}/>
  <asset>{assets}</asset>
  <worldbody>
    {world}
    <body name="upper">
      <joint name="j1" axis="0 1 0" armature="0.01"/>
      <geom type="mesh" mesh="link" {geom}/>
      <body name="lower" pos="0.1 0 0">
        <joint name="j2" axis="0 1 0" armature="0.01"/>
        <geom size="0.02" mass="0.1"/>
        {lower}
      </body>
    </body>
  </worldbody>
  <actuator><position name="j1" joint="j1" kp="5"/><position name="j2" joint="j2" kp="5"/></actuator>
  {keyframes}
</mujoco>
"""
CHILD = """
<mujoco model="child">
  <compiler angle="radian" meshdir="parts"/>
  <asset><mesh name="link" file="link.stl"/></asset>
  <worldbody><body name="tool"><geom type="mesh" mesh="link"/></body></worldbody>
</mujoco>
"""
LINK = '<mesh name="link" file="link.stl"/>'
FIELD = '<hfield name="floor" file="floor.bin" size="1 1 0.1 0.1"/>'
PARTS = {
    "mesh": {"folders": 'meshdir="meshes"', "assets": LINK},
    "height field": {
        "folders": 'meshdir="meshes"',
        "assets": LINK + FIELD,
        "world": '<geom type="hfield" hfield="floor" pos="0 0 -1"/>',
    },
    "texture": {
        "folders": 'meshdir="meshes" texturedir="pictures"',
        "assets": LINK + '<texture name="t" type="2d" file="t.png"/><material name="m" texture="t"/>',
        "geom": 'material="m"',
    },
    "attached": {
        "folders": 'meshdir="meshes"',
        "assets": LINK + '<model name="child" file="child/child.xml"/>',
        "lower": '<body name="mount"><attach model="child" body="tool" prefix="c_"/></body>',
    },
}


def write_mesh(path: Path, size: float) -> None:
    corners = size * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    faces = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
    triangles = [struct.pack("<12fH", 0, 0, 0, *corners[list(face)].ravel(), 0) for face in faces]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(bytes(80) + struct.pack("<I", len(faces)) + b"".join(triangles))


def arm(folder: Path, kind: str = "mesh", **parts: str) -> Path:
    """Write a model with files of some kind beside it."""
    from PIL import Image

    for name, size in (("meshes", 0.1), ("child/parts", 0.05)):
        write_mesh(folder / name / "link.stl", size)
    (folder / "meshes/floor.bin").write_bytes(struct.pack("<ii4f", 2, 2, 0, 1, 0.5, 0.2))
    (folder / "pictures").mkdir()
    Image.new("RGB", (2, 2), "red").save(folder / "pictures/t.png")
    (folder / "child/child.xml").write_text(CHILD)
    path = folder / "arm.xml"
    empty = dict.fromkeys(("folders", "assets", "world", "geom", "lower", "keyframes"), "")
    path.write_text(ARM.format(**empty | PARTS[kind] | parts))
    return path


def nominal(path: Path, joints: Sequence[str] = ("j1", "j2")) -> Nominal:
    n = len(joints)
    moving, counts = np.zeros((1, 20, n)), np.ones((1, 20), bool)
    return Nominal.load(path, EpisodeBatch(tuple(joints), 0.01, np.zeros((1, n)), moving, moving, counts, np.zeros(1)))


def delivered(folder: Path, given: Nominal, *effects: Effect) -> mujoco.MjModel:
    """Write the model, move everything elsewhere and load it in plain MuJoCo."""
    (folder / "report").mkdir()
    write_model(folder / "report", given, effects, {})
    shutil.move(folder / "report", folder / "moved")
    return mujoco.MjModel.from_xml_path(str(folder / "moved/model.xml"))


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
    write_portable(given.edited({}), tmp_path / "elsewhere/arm.xml", tmp_path / "model.xml")
    after = mujoco.MjModel.from_xml_path(str(tmp_path / "model.xml"))
    assert after.nmesh == 0
    before = given.spec.copy().compile()
    assert after.body_mass == pytest.approx(before.body_mass, rel=1e-5)
    assert after.body_inertia == pytest.approx(before.body_inertia, rel=1e-5)


def test_a_model_that_cannot_be_written_is_refused_before_the_search(tmp_path: Path, monkeypatch, capsys):
    from test_gap_workflow import recorded

    from nas_data.cli import main

    path = arm(tmp_path / "given")
    with pytest.raises(ModelFileError, match=r"arm\.xml cannot be written as a model of its own"):
        check_portable(nominal(path).spec, tmp_path / "elsewhere/arm.xml")
    data = recorded(path, tmp_path / "data", "--episodes", "2")
    monkeypatch.setattr("nas_data.gap.export.find_file", lambda *given: None)
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
