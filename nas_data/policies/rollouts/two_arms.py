"""Collision model of two arms: contacts of the attacker with itself, the floor and the defender."""

from dataclasses import replace
from functools import partial

import mujoco

from nas_data.envs.base import in_turn
from nas_data.recorders.path_planner import PathPlanner
from nas_data.robots.ergo_shield import DEFENDER, DEFENDERS_JOINTS
from nas_data.robots.ergo_shield import ROBOT as DUEL
from nas_data.robots.ergojr import JOINTS

HULLS = ("case", "hull2", "hull4", "hull5")  # collision hulls from the base to the link before the tip
# The hull of the tip is that of an arm with its plain tip, and reaches beyond sword and shield. Between two arms the
# servo that it covers stands for it: so a sword may lie on a shield.
SERVO = "motor6"
OWN, OTHER, SWORD, SHIELD = 1, 2, 4, 8  # collision bits; the model's hulls and floor have the first


def tell_apart(spec: mujoco.MjSpec) -> None:
    """Enable contacts of the attacker with itself, the floor and the defender's body, and no others."""
    for name in (*HULLS, SERVO):
        spec.geom(name).conaffinity |= OTHER
        spec.geom(DEFENDER + name).contype, spec.geom(DEFENDER + name).conaffinity = OTHER, 0
    spec.geom(DEFENDER + "hull6").contype = spec.geom(DEFENDER + "hull6").conaffinity = 0


def add_edges(spec: mujoco.MjSpec) -> None:
    """Enable contacts of sword with defender and of shield with attacker, but not of the tips with each other."""
    tell_apart(spec)
    spec.geom("sword").contype, spec.geom(DEFENDER + "shield").contype = SWORD, SHIELD
    for name in HULLS:
        spec.geom(DEFENDER + name).conaffinity |= SWORD
        spec.geom(name).conaffinity |= SHIELD


def keep_clear(spec: mujoco.MjSpec, clearance: float) -> None:
    """Count a distance between the arms below the clearance [m] as a contact."""
    for geom in spec.geoms:
        if geom.name.startswith(DEFENDER):
            geom.margin = clearance


def make_two_arm_planner(edges: bool = False, clearance: float = 0.0) -> PathPlanner:
    """Return the collision checks of both arms, in poses [rad], shape (12,), with the attacker's joints first.

    Args:
        edges: Whether sword and shield collide with the other arm's body. They do not in the environment's model, so
            policies that were trained there pass through.
        clearance: Distance between the arms below which they count as in contact [m].
    """
    touching = in_turn(add_edges if edges else tell_apart, partial(keep_clear, clearance=clearance))
    edit = in_turn(DUEL.edit, touching)
    return PathPlanner(replace(DUEL, name="two_ergojr", joints=(*JOINTS, *DEFENDERS_JOINTS), edit=edit))
