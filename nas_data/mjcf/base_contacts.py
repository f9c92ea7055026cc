"""Contacts of a fixed base with the links that joints connect to it: they are excluded.

Links that a joint connects overlap at the joint. MuJoCo excludes their contact by itself, except where the parent is
fixed to the world: there the shapes of base and first link would push the arm all the time.
"""

import mujoco
import numpy as np

from nas_data.mjcf.unique_name import make_unique_name


def find_base_contacts(model: mujoco.MjModel, base: int = 0) -> list[tuple[int, int]]:
    """Return the pairs of a base's bodies and its first links, by index, that may collide.

    Args:
        model: Compiled model.
        base: Index of the base; 0 for the world and all that is fixed to it.
    """
    collides = np.zeros(model.nbody, bool)
    collides[model.geom_bodyid[(model.geom_contype != 0) | (model.geom_conaffinity != 0)]] = True
    bodies = range(1, model.nbody)
    links = [body for body in bodies if model.body_weldid[body] == body and is_jointed_to(model, body, base)]
    fixed = np.flatnonzero((model.body_weldid == base) & collides).tolist()
    moving = np.flatnonzero(np.isin(model.body_weldid, links) & collides).tolist()
    excluded = set(model.exclude_signature.tolist())
    pairs = [(one, other) for one in fixed for other in moving]
    return [(one, other) for one, other in pairs if (min(one, other) << 16) + max(one, other) not in excluded]


def is_jointed_to(model: mujoco.MjModel, body: int, base: int) -> bool:
    """Whether joints other than a free joint connect a body to a base."""
    first = int(model.body_jntadr[body])
    jointed = first >= 0 and int(model.jnt_type[first]) != int(mujoco.mjtJoint.mjJNT_FREE)
    return bool(jointed and model.body_weldid[model.body_parentid[body]] == base)


def exclude_base_contacts(spec: mujoco.MjSpec, base: int = 0) -> None:
    """Exclude the contacts that `find_base_contacts` finds; bodies without a name get one."""
    for pair in find_base_contacts(spec.copy().compile(), base):
        for body in (spec.bodies[index] for index in pair):
            body.name = body.name or make_unique_name(spec.body, "body")
        spec.add_exclude(bodyname1=spec.bodies[pair[0]].name, bodyname2=spec.bodies[pair[1]].name)
