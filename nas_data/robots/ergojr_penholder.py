"""Poppy Ergo Jr with the pen holder of the paper's ErgoReacher and ErgoShield."""

from dataclasses import replace

import mujoco

from nas_data.robots.ergojr import ROBOT as ERGOJR

HOLDER_DISTANCE = 0.030  # [m] from the axis of m6 to the holder, the authors' ErgoJr chain
HOLDER_MASS = 0.004  # [kg] the authors' ErgoJr
HOLDER_RADIUS, HOLDER_LENGTH = 0.007, 0.024  # [m] a sleeve around a pen


def add_penholder(spec: mujoco.MjSpec) -> None:
    """Add the pen holder to the last link, and move the site `tip` to its middle, as in the paper's reward."""
    holder = spec.body("link6").add_body(name="penholder", pos=[0, HOLDER_DISTANCE, 0])
    holder.add_geom(
        name="penholder",
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        size=[HOLDER_RADIUS, HOLDER_LENGTH / 2, 0],
        mass=HOLDER_MASS,
        contype=0,
        conaffinity=0,
        group=1,
        rgba=[0.95, 0.75, 0.2, 1],
    )
    spec.site("tip").pos = [0, HOLDER_DISTANCE, 0]


ROBOT = replace(ERGOJR, name="ergojr_penholder", edit=add_penholder)
