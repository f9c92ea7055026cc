"""Contacts between the fixed base of a URDF and the links that joints connect to it: they do not collide.

Links that a joint connects overlap at the joint, so that their contact is excluded: MuJoCo does so by itself, except
where the parent is fixed to the world. The convex hulls of a base and its first link would push the arm all the time.
"""

import mujoco
import numpy as np


def find_base_contacts(spec: mujoco.MjSpec) -> list[tuple[str, str]]:
    """Return the pairs of names of fixed bodies and their moving children that may collide."""
    model = spec.copy().compile()
    collides = np.zeros(model.nbody, bool)
    collides[model.geom_bodyid[(model.geom_contype != 0) | (model.geom_conaffinity != 0)]] = True
    excluded = set(model.exclude_signature.tolist())
    found = []
    for body in range(1, model.nbody):
        parent = int(model.body_parentid[body])
        moves = model.body_jntnum[body] and model.jnt_type[model.body_jntadr[body]] != int(mujoco.mjtJoint.mjJNT_FREE)
        fixed = model.body_weldid[parent] == 0
        if fixed and moves and collides[[parent, body]].all() and (parent << 16) + body not in excluded:
            found.append((str(model.body(parent).name), str(model.body(body).name)))
    return found


def exclude_base_contacts(spec: mujoco.MjSpec) -> None:
    """Exclude the contacts that `find_base_contacts` finds."""
    for fixed, moving in find_base_contacts(spec):
        spec.add_exclude(bodyname1=fixed, bodyname2=moving)
