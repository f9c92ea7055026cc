"""A copy of a model that needs no other files: shapes that lie in meshes are left out, masses and motion stay."""

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import mujoco

from nas_data.mjcf.bake_inertia import explicit

SHAPES = (mujoco.mjtGeom.mjGEOM_MESH, mujoco.mjtGeom.mjGEOM_SDF, mujoco.mjtGeom.mjGEOM_HFIELD)
ALL_DIGITS = 17  # after which a double reads back as it was


def needs_files(spec: mujoco.MjSpec) -> bool:
    """Whether a model needs meshes, textures, height fields or skins from files beside its own."""
    groups = (spec.meshes, spec.hfields, spec.skins)
    return any(item.file for group in groups for item in group) or any(_from_file(item) for item in spec.textures)


def colliding_shapes(spec: mujoco.MjSpec) -> int:
    """Return how many of the geoms that `meshless` leaves out can touch something."""
    paired = {name for pair in spec.pairs for name in (pair.geomname1, pair.geomname2)}
    shapes = [geom for geom in spec.geoms if geom.type in SHAPES]
    return sum(bool(geom.contype or geom.conaffinity or geom.name in paired) for geom in shapes)


def meshless(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """Return a model that moves the same where nothing touches, without what lies in other files.

    Args:
        spec: Model whose files are at hand.

    Returns:
        Masses and inertias written out; geoms of meshes and height fields, textures and skins removed.
    """
    alone = explicit(spec)
    model = alone.compile()
    _delete_references(alone, {geom.name for geom in alone.geoms if geom.name and geom.type in SHAPES})
    for geom in list(alone.geoms):
        if geom.type in SHAPES:
            alone.delete(geom)
        else:
            _write_fitted_shape(geom, model)
    for material in alone.materials:
        material.textures = [""] * len(material.textures)
    _forget_meshes(alone.default)
    for group in (alone.skins, alone.meshes, alone.hfields, alone.textures):
        for item in list(group):
            alone.delete(item)
    alone.compile()
    return alone


def exact_xml(spec: mujoco.MjSpec) -> bytes:
    """Return a compiled model as MJCF whose numbers read back to the last bit."""
    with _all_digits():
        return bytes(spec.to_xml().encode())


def _from_file(texture: mujoco.MjsTexture) -> bool:
    """Whether a texture is read from one file, or from six that make a cube."""
    return bool(texture.file or any(texture.cubefiles))


def _delete_references(spec: mujoco.MjSpec, geoms: set[str]) -> None:
    """Delete contact pairs and sensors of geoms that are to be removed."""
    for pair in list(spec.pairs):
        if {pair.geomname1, pair.geomname2} & geoms:
            spec.delete(pair)
    for sensor in list(spec.sensors):
        ends = ((sensor.objtype, sensor.objname), (sensor.reftype, sensor.refname))
        if any(kind == mujoco.mjtObj.mjOBJ_GEOM and name in geoms for kind, name in ends):
            spec.delete(sensor)


def _write_fitted_shape(geom: mujoco.MjsGeom, model: mujoco.MjModel) -> None:
    """Write out a primitive that was fitted to a mesh, as the compiler found it."""
    if geom.meshname:
        number = geom.id
        geom.size, geom.pos, geom.quat = model.geom_size[number], model.geom_pos[number], model.geom_quat[number]
        geom.meshname = ""


def _forget_meshes(default: mujoco.MjsDefault) -> None:
    """Take the mesh or height field out of the main default class."""
    default.geom.meshname, default.geom.hfieldname = "", ""


@contextmanager
def _all_digits() -> Iterator[None]:
    """Make MuJoCo write all digits of a number; by itself it writes six, and the Python binding has no word for it."""
    library = ctypes.CDLL(str(next(Path(mujoco.__file__).parent.glob("libmujoco*"))))
    before = library._mjPRIVATE__get_xml_precision()
    library._mjPRIVATE__set_xml_precision(ALL_DIGITS)
    try:
        yield
    finally:
        library._mjPRIVATE__set_xml_precision(before)
