"""Models that a gap report can deliver: an arm with parts in files beside it."""

import shutil
import struct
from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np

from nas_data.effects.base import Effect
from nas_data.gap.episode_batch import EpisodeBatch
from nas_data.gap.nominal import Nominal
from nas_data.gap.write_model import write_model

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
