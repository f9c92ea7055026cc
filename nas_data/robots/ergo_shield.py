"""Two ErgoJr face to face: the one that is commanded holds a sword, the other a shield."""

from dataclasses import replace

import mujoco
import numpy as np

from nas_data.robots.ergojr import JOINTS
from nas_data.robots.ergojr_penholder import ROBOT as ARM
from nas_data.robots.ergojr_penholder import add_penholder

DISTANCE = 0.37  # [m] between the two bases, the second turned by half a turn; the authors' scene
SWORD_ABOVE, SWORD_BELOW = 0.135, 0.015  # [m] of the pencil beyond the holder's middle, the authors' model
SWORD_RADIUS = 0.0035  # [m] the authors' model
SWORD_MASS = 0.006  # [kg] a wooden pencil of that size; the authors give none
SHIELD_RADIUS, SHIELD_HALF = 0.0235, 0.0025  # [m] a disc 5 mm thick, the authors' model
SHIELD_MASS = 0.004  # [kg] that disc at the density of printed plastic; the authors give none

DEFENDER = "defender_"  # prefix of all that belongs to the second arm
DEFENDERS_JOINTS = tuple(DEFENDER + joint for joint in JOINTS)
SWORD_TOP, SWORD_BOTTOM = "sword_top", "sword_bottom"  # sites at the sword's ends
SHIELD_CENTRE, SHIELD_FRONT = DEFENDER + "shield_centre", DEFENDER + "shield_front"  # sites on the shield's axis
# Sword and shield pass through each other: a touch ends the bout at once, so that what the blow would do never shows,
# and every engine is asked the same question of geometry.
SEEN_ONLY = {"contype": 0, "conaffinity": 0, "group": 1}


def add_duel(spec: mujoco.MjSpec) -> None:
    """Give an ErgoJr a sword in a pen holder, and an opponent with a shield in its own."""
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
    """Put a pencil into the holder; in the zero posture it points upwards."""
    holder.add_geom(
        name="sword",
        type=mujoco.mjtGeom.mjGEOM_CAPSULE,
        fromto=[0, 0, -SWORD_BELOW, 0, 0, SWORD_ABOVE],
        size=[SWORD_RADIUS, 0, 0],
        mass=SWORD_MASS,
        rgba=[0.2, 0.5, 0.3, 1],
        **SEEN_ONLY,
    )
    holder.add_site(name=SWORD_TOP, pos=[0, 0, SWORD_ABOVE])
    holder.add_site(name=SWORD_BOTTOM, pos=[0, 0, -SWORD_BELOW])


def add_shield(holder: mujoco.MjsBody) -> None:
    """Put a disc before the holder that faces what is before the arm."""
    holder.add_geom(
        name="shield",
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        quat=[np.sqrt(0.5), np.sqrt(0.5), 0, 0],  # its axis along y
        size=[SHIELD_RADIUS, SHIELD_HALF, 0],
        mass=SHIELD_MASS,
        rgba=[0.8, 0.3, 0.2, 1],
        **SEEN_ONLY,
    )
    holder.add_site(name=SHIELD_CENTRE.removeprefix(DEFENDER), pos=[0, 0, 0])
    holder.add_site(name=SHIELD_FRONT.removeprefix(DEFENDER), pos=[0, 1, 0])  # 1 m before it: a unit vector apart


ROBOT = replace(ARM, name="ergo_shield", edit=add_duel)
