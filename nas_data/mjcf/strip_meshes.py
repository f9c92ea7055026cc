"""Copies of a model without meshes and other assets, with the same masses and dynamics."""

import ctypes
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import mujoco

from nas_data.mjcf.bake_inertia import bake_inertia

SHAPES = (mujoco.mjtGeom.mjGEOM_MESH, mujoco.mjtGeom.mjGEOM_SDF, mujoco.mjtGeom.mjGEOM_HFIELD)
ALL_DIGITS = 17  # significant digits with which a double reads back exactly

_precision_lock = threading.Lock()  # the precision is one setting of the process


def needs_files(spec: mujoco.MjSpec) -> bool:
    """Whether a model refers to files with meshes, textures, height fields or skins."""
    groups = (spec.meshes, spec.hfields, spec.skins)
    textures = any(texture.file or any(texture.cubefiles) for texture in spec.textures)
    return textures or any(item.file for group in groups for item in group)


def count_colliding_geoms(spec: mujoco.MjSpec) -> int:
    """Return the number of colliding geoms that `strip_meshes` would remove."""
    paired = {name for pair in spec.pairs for name in (pair.geomname1, pair.geomname2)}
    shapes = [geom for geom in spec.geoms if geom.type in SHAPES]
    return sum(bool(geom.contype or geom.conaffinity or geom.name in paired) for geom in shapes)


def strip_meshes(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """Return a model without assets, whose dynamics are the same except for contacts.

    Args:
        spec: Model whose files are available.

    Returns:
        Model with explicit masses and inertias, without textures, skins, and geoms of meshes and height fields.
    """
    alone = bake_inertia(spec)
    model = alone.compile()
    _delete_references(alone, {geom.name for geom in alone.geoms if geom.name and geom.type in SHAPES})
    for geom in list(alone.geoms):
        if geom.type in SHAPES:
            alone.delete(geom)
        else:
            _write_fitted_shape(geom, model)
    for material in alone.materials:
        material.textures = [""] * len(material.textures)
    alone.default.geom.meshname = alone.default.geom.hfieldname = ""
    for group in (alone.skins, alone.meshes, alone.hfields, alone.textures):
        for item in list(group):
            alone.delete(item)
    alone.compile()
    return alone


def format_exact_xml(spec: mujoco.MjSpec) -> bytes:
    """Return a compiled model as MJCF whose numbers read back exactly."""
    with _full_precision():
        return bytes(spec.to_xml().encode())


def _delete_references(spec: mujoco.MjSpec, geoms: set[str]) -> None:
    """Delete contact pairs and sensors that refer to given geoms."""
    for pair in list(spec.pairs):
        if {pair.geomname1, pair.geomname2} & geoms:
            spec.delete(pair)
    for sensor in list(spec.sensors):
        ends = ((sensor.objtype, sensor.objname), (sensor.reftype, sensor.refname))
        if any(kind == mujoco.mjtObj.mjOBJ_GEOM and name in geoms for kind, name in ends):
            spec.delete(sensor)


def _write_fitted_shape(geom: mujoco.MjsGeom, model: mujoco.MjModel) -> None:
    """Give a primitive that the compiler fits to a mesh its fitted size and pose."""
    if geom.meshname:
        number = geom.id
        geom.size, geom.pos, geom.quat = model.geom_size[number], model.geom_pos[number], model.geom_quat[number]
        geom.meshname = ""


@contextmanager
def _full_precision() -> Iterator[None]:
    """Let MuJoCo write numbers with all digits instead of six; its Python binding has no option for this."""
    library = ctypes.CDLL(str(next(Path(mujoco.__file__).parent.glob("libmujoco*"))))
    with _precision_lock:
        before = library._mjPRIVATE__get_xml_precision()
        library._mjPRIVATE__set_xml_precision(ALL_DIGITS)
        try:
            yield
        finally:
            library._mjPRIVATE__set_xml_precision(before)
