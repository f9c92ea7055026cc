"""Lowest points of an arm's collision shapes."""

from collections.abc import Sequence

import mujoco
import numpy as np

from nas_data.mjcf.free_bodies import find_free_bodies

SPHERE, CAPSULE, ELLIPSOID, CYLINDER, BOX, MESH = SHAPES = tuple(
    int(getattr(mujoco.mjtGeom, f"mjGEOM_{name}"))
    for name in ("SPHERE", "CAPSULE", "ELLIPSOID", "CYLINDER", "BOX", "MESH")
)
JOINTS = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))


def find_arm_geoms(model: mujoco.MjModel) -> list[int]:
    """Return the indices of the collision shapes that hinges and slides move, without objects on free joints."""
    free = find_free_bodies(model)
    return [
        geom
        for geom in range(model.ngeom)
        if model.body_weldid[model.geom_bodyid[geom]]
        and not free[model.geom_bodyid[geom]]
        and model.geom_contype[geom] | model.geom_conaffinity[geom]
        and model.geom_type[geom] in SHAPES
    ]


def find_first_anchor(model: mujoco.MjModel) -> np.ndarray:
    """Return the anchor of the first hinge or slide in the reference posture [m], shape (3,)."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    first = int(np.flatnonzero(np.isin(model.jnt_type, JOINTS))[0])
    return np.array(data.xanchor[first])


def find_lowest_point(model: mujoco.MjModel, data: mujoco.MjData, geoms: Sequence[int]) -> float:
    """Return the height of the lowest point of some shapes [m], after `mj_kinematics`."""
    return min(find_lowest_height(model, data, geom) for geom in geoms)


def find_lowest_height(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> float:
    """Return the height of a shape's lowest point [m], after `mj_kinematics`."""
    up, size = data.geom_xmat[geom].reshape(3, 3)[2], model.geom_size[geom]
    height = float(data.geom_xpos[geom, 2])
    kind = int(model.geom_type[geom])
    if kind == MESH:
        mesh = model.geom_dataid[geom]
        first = model.mesh_vertadr[mesh]
        return height + float((model.mesh_vert[first : first + model.mesh_vertnum[mesh]] @ up).min())
    reach = {
        SPHERE: size[0],
        CAPSULE: size[0] + abs(up[2]) * size[1],
        ELLIPSOID: np.linalg.norm(up * size),
        CYLINDER: np.hypot(up[0], up[1]) * size[0] + abs(up[2]) * size[1],
        BOX: np.abs(up) @ size,
    }
    return height - float(reach[kind])
