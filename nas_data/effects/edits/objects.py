"""Objects in a scene: what moves and can be pushed, but is not driven."""

import mujoco
import numpy as np

from nas_data.errors import ModelFileError


def find_objects(model: mujoco.MjModel, effect: str) -> list[int]:
    """Return the bodies of all objects: kinematic trees with colliding geoms in which no actuator acts.

    Args:
        model: Compiled model; bodies and geoms of an editable one come in the same order.
        effect: Who asks, for the error.

    Raises:
        ModelFileError: there is none.
    """
    free = set(range(model.ntree)) - driven_trees(model)
    touchable = {
        int(model.body_treeid[model.geom_bodyid[geom]]) for geom in range(model.ngeom) if collides(model, geom)
    }
    bodies = [body for body in range(model.nbody) if int(model.body_treeid[body]) in free & touchable]
    if not bodies:
        raise ModelFileError(
            f"{effect} acts on a pushed object; the model has none: add a body with a free joint, or with slides or "
            "hinges that no actuator drives, whose geoms collide."
        )
    return bodies


def driven_trees(model: mujoco.MjModel) -> set[int]:
    """Return the kinematic trees in which an actuator moves some joint in the reference posture."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    rows = zip(data.moment_rowadr, data.moment_rownnz, strict=True)
    return {int(model.dof_treeid[dof]) for first, count in rows for dof in data.moment_colind[first : first + count]}


def collides(model: mujoco.MjModel, geom: int) -> bool:
    """Whether a geom can touch anything."""
    return bool(model.geom_contype[geom] or model.geom_conaffinity[geom])


def partners(model: mujoco.MjModel, geom: int) -> list[int]:
    """Return the geoms outside an object's own tree that one of its geoms may touch, contacts written out aside."""
    match = (model.geom_contype[geom] & model.geom_conaffinity) | (model.geom_contype & model.geom_conaffinity[geom])
    body = int(model.geom_bodyid[geom])
    others = np.flatnonzero(match != 0)
    apart = model.body_treeid[model.geom_bodyid[others]] != model.body_treeid[body]
    return [int(other) for other in others[apart] if not excluded(model, body, int(model.geom_bodyid[other]))]


def excluded(model: mujoco.MjModel, first: int, second: int) -> bool:
    """Whether the model excludes contacts of two bodies."""
    low, high = sorted((first, second))
    return (low << 16) + high in model.exclude_signature


def contact_friction(model: mujoco.MjModel, first: int, second: int) -> np.ndarray:
    """Return sliding, spinning and rolling friction in the contact of two geoms as the engine mixes it, shape (3,)."""
    one, two = model.geom_priority[first], model.geom_priority[second]
    if one == two:
        return np.asarray(np.maximum(model.geom_friction[first], model.geom_friction[second]))
    return np.asarray(model.geom_friction[first if one > two else second])
