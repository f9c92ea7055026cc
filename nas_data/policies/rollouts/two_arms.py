"""Two arms as one: in which poses of both one touches the other, beside what the attacker touches by itself."""

from dataclasses import replace
from functools import partial

import mujoco

from nas_data.envs.base import in_turn
from nas_data.recorders.path_planner import PathPlanner
from nas_data.robots.ergo_shield import DEFENDER, DEFENDERS_JOINTS
from nas_data.robots.ergo_shield import ROBOT as DUEL
from nas_data.robots.ergojr import JOINTS

HULLS = ("case", "hull2", "hull4", "hull5")  # of what carries the tip, from the base on
# The hull of the tip is that of an arm with its plain tip, and reaches beyond sword and shield. Between two arms the
# servo that it covers stands for it: so a sword may lie on a shield.
SERVO = "motor6"
OWN, OTHER, SWORD, SHIELD = 1, 2, 4, 8  # bits of what collides; the model's hulls and its floor have the first


def tell_apart(spec: mujoco.MjSpec) -> None:
    """Let the attacker touch itself, the floor and the defender's body, and the defender nothing else."""
    for name in (*HULLS, SERVO):
        spec.geom(name).conaffinity |= OTHER
        spec.geom(DEFENDER + name).contype, spec.geom(DEFENDER + name).conaffinity = OTHER, 0
    spec.geom(DEFENDER + "hull6").contype = spec.geom(DEFENDER + "hull6").conaffinity = 0


def add_edges(spec: mujoco.MjSpec) -> None:
    """Let the sword touch the defender and the shield the attacker, all but the tips: there one strikes the other."""
    tell_apart(spec)
    spec.geom("sword").contype, spec.geom(DEFENDER + "shield").contype = SWORD, SHIELD
    for name in HULLS:
        spec.geom(DEFENDER + name).conaffinity |= SWORD
        spec.geom(name).conaffinity |= SHIELD


def keep_clear(spec: mujoco.MjSpec, clearance: float) -> None:
    """Let what of the defender comes so near [m] to the attacker count as a touch."""
    for geom in spec.geoms:
        if geom.name.startswith(DEFENDER):
            geom.margin = clearance


def make_two_arm_planner(edges: bool = False, clearance: float = 0.0) -> PathPlanner:
    """Return what an attacker and a defender touch, in poses of the one then the other [rad], shape (12,).

    Args:
        edges: Whether the sword on the defender's body, and the shield on the attacker's, are touches as well. In the
            environment's model they are not, and policies that learned there pass through.
        clearance: How near the two may come before that is a touch [m].
    """
    touching = in_turn(add_edges if edges else tell_apart, partial(keep_clear, clearance=clearance))
    edit = in_turn(DUEL.edit, touching)
    return PathPlanner(replace(DUEL, name="two_ergojr", joints=(*JOINTS, *DEFENDERS_JOINTS), edit=edit))
