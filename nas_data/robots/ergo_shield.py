"""Two ErgoJr face to face: the commanded one holds a sword, the other one a shield."""

from dataclasses import replace

import mujoco
import numpy as np

from nas_data.robots.ergojr import JOINTS
from nas_data.robots.ergojr_penholder import ROBOT as ARM
from nas_data.robots.ergojr_penholder import add_penholder

DISTANCE = 0.37  # [m] between the bases; the second one is rotated by half a turn; the authors' scene
SWORD_ABOVE, SWORD_BELOW = 0.135, 0.015  # [m] length of the pencil above and below the holder, the authors' model
SWORD_RADIUS = 0.0035  # [m] the authors' model
SWORD_MASS = 0.006  # [kg] a wooden pencil of that size; the authors give none
SHIELD_RADIUS, SHIELD_HALF = 0.0235, 0.0025  # [m] a disc 5 mm thick, the authors' model
SHIELD_MASS = 0.004  # [kg] that disc at the density of printed plastic; the authors give none

DEFENDER = "defender_"  # prefix of the elements of the second arm
DEFENDERS_JOINTS = tuple(DEFENDER + joint for joint in JOINTS)
SWORD_TOP, SWORD_BOTTOM = "sword_top", "sword_bottom"  # sites at the sword's ends
SHIELD_CENTRE, SHIELD_FRONT = DEFENDER + "shield_centre", DEFENDER + "shield_front"  # sites on the shield's axis
# Sword and shield do not collide: a touch ends the episode, so that the contact forces do not matter, and the touch is
# computed from geometry, in the same way for every engine.
VISUAL = {"contype": 0, "conaffinity": 0, "group": 1}


def add_duel(spec: mujoco.MjSpec) -> None:
    """Add a sword in a pen holder to an ErgoJr, and an opponent with a shield in its pen holder."""
    defender = ARM.spec()
    add_penholder(spec)
    add_sword(spec.body("penholder"))
    add_shield(defender.body("penholder"))
    defender.delete(defender.geom("floor"))
    for light in defender.lights:
        defender.delete(light)
    half_turn = np.array([0.0, 0.0, 0.0, 1.0])
    spec.attach(defender, prefix=DEFENDER, frame=spec.worldbody.add_frame(pos=[0, DISTANCE, 0], quat=half_turn))


def add_sword(holder: mujoco.MjsBody) -> None:
    """Add a pencil to the holder; in the zero posture it points upwards."""
    holder.add_geom(
        name="sword",
        type=mujoco.mjtGeom.mjGEOM_CAPSULE,
        fromto=[0, 0, -SWORD_BELOW, 0, 0, SWORD_ABOVE],
        size=[SWORD_RADIUS, 0, 0],
        mass=SWORD_MASS,
        rgba=[0.2, 0.5, 0.3, 1],
        **VISUAL,
    )
    holder.add_site(name=SWORD_TOP, pos=[0, 0, SWORD_ABOVE])
    holder.add_site(name=SWORD_BOTTOM, pos=[0, 0, -SWORD_BELOW])


def add_shield(holder: mujoco.MjsBody) -> None:
    """Add a disc to the holder, facing forwards."""
    holder.add_geom(
        name="shield",
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        quat=[np.sqrt(0.5), np.sqrt(0.5), 0, 0],  # its axis along y
        size=[SHIELD_RADIUS, SHIELD_HALF, 0],
        mass=SHIELD_MASS,
        rgba=[0.8, 0.3, 0.2, 1],
        **VISUAL,
    )
    holder.add_site(name=SHIELD_CENTRE.removeprefix(DEFENDER), pos=[0, 0, 0])
    # 1 m in front of the centre, so that their difference is a unit vector
    holder.add_site(name=SHIELD_FRONT.removeprefix(DEFENDER), pos=[0, 1, 0])


ROBOT = replace(ARM, name="ergo_shield", edit=add_duel)
