"""Objects in a scene: bodies that can move and collide but that no actuator drives."""

from collections.abc import Callable
from functools import partial
from typing import TypeAlias

import mujoco
import numpy as np

from nas_data.errors import ModelFileError

Mix: TypeAlias = Callable[[np.ndarray, np.ndarray], np.ndarray]


def find_objects(model: mujoco.MjModel, effect: str) -> list[int]:
    """Return the bodies of all objects: kinematic trees with colliding geoms in which no actuator acts.

    Args:
        model: Compiled model; its spec has bodies and geoms in the same order.
        effect: Name of the effect, for the error.

    Raises:
        ModelFileError: the model has no object.
    """
    free = set(range(model.ntree)) - find_driven_trees(model)
    colliding = {
        int(model.body_treeid[model.geom_bodyid[geom]]) for geom in range(model.ngeom) if can_collide(model, geom)
    }
    bodies = [body for body in range(model.nbody) if int(model.body_treeid[body]) in free & colliding]
    if not bodies:
        raise ModelFileError(
            f"{effect} needs a pushed object, and the model has none: add a body with a free joint, or with slides or "
            "hinges that no actuator drives, whose geoms collide."
        )
    return bodies


def find_driven_trees(model: mujoco.MjModel) -> set[int]:
    """Return the kinematic trees in which an actuator moves some joint in the reference posture."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    rows = zip(data.moment_rowadr, data.moment_rownnz, strict=True)
    return {int(model.dof_treeid[dof]) for first, count in rows for dof in data.moment_colind[first : first + count]}


def can_collide(model: mujoco.MjModel, geom: int) -> bool:
    """Whether a geom can touch anything."""
    return bool(model.geom_contype[geom] or model.geom_conaffinity[geom])


def find_partners(model: mujoco.MjModel, geom: int) -> list[int]:
    """Return the geoms outside an object's tree that one of its geoms can touch; explicit pairs are not considered."""
    match = (model.geom_contype[geom] & model.geom_conaffinity) | (model.geom_contype & model.geom_conaffinity[geom])
    body = int(model.geom_bodyid[geom])
    others = np.flatnonzero(match != 0)
    apart = model.body_treeid[model.geom_bodyid[others]] != model.body_treeid[body]
    return [
        int(other) for other in others[apart] if not is_contact_excluded(model, body, int(model.geom_bodyid[other]))
    ]


def is_contact_excluded(model: mujoco.MjModel, first: int, second: int) -> bool:
    """Whether the model excludes contacts of two bodies."""
    low, high = sorted((first, second))
    return (low << 16) + high in model.exclude_signature


def add_contact(spec: mujoco.MjSpec, model: mujoco.MjModel, first: int, second: int) -> mujoco.MjsPair:
    """Add the explicit contact pair of two named geoms, with the parameters that MuJoCo would mix from theirs.

    Source: MuJoCo documentation, Computation, Contact, Parameters.
    """
    pair = spec.add_pair(geomname1=spec.geoms[first].name, geomname2=spec.geoms[second].name)
    slide, spin, roll = mix_contact_parameter(model, "friction", first, second, np.maximum)
    pair.friction = [slide, slide, spin, roll, roll]
    pair.condim = int(mix_contact_parameter(model, "condim", first, second, np.maximum))
    weights = model.geom_solmix[[first, second]]
    mean = partial(mix_solver_parameters, share=float(weights[0] / weights.sum()) if weights.sum() > 0 else 0.5)
    pair.solref, pair.solimp = (
        mix_contact_parameter(model, field, first, second, mean) for field in ("solref", "solimp")
    )
    pair.solreffriction = np.zeros(2)  # zero means: as in normal direction
    pair.margin, pair.gap = (float(getattr(model, "geom_" + each)[[first, second]].sum()) for each in ("margin", "gap"))
    return pair


def mix_contact_parameter(model: mujoco.MjModel, field: str, first: int, second: int, mix: Mix) -> np.ndarray:
    """Return a contact's parameter: that of the geom of higher priority; for equal priority, a mix."""
    ranks, values = model.geom_priority[[first, second]], getattr(model, "geom_" + field)[[first, second]]
    return np.asarray(mix(*values) if ranks[0] == ranks[1] else values[int(np.argmax(ranks))])


def mix_solver_parameters(one: np.ndarray, other: np.ndarray, share: float) -> np.ndarray:
    """Return the weighted mean of two solref or solimp; the minimum if a solref is a stiffness, which is negative."""
    direct = one[0] <= 0 or other[0] <= 0
    return np.asarray(np.minimum(one, other) if direct else share * one + (1 - share) * other)
