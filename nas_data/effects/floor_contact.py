"""A floor or table that the arm touches."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np

from nas_data.effects.base import Effect, Parameter, Scales
from nas_data.effects.edits.press import enable_contacts
from nas_data.errors import ModelFileError
from nas_data.mjcf.lowest_point import find_arm_geoms, find_first_anchor
from nas_data.mjcf.unique_name import make_unique_name

NAME = "floor_contact"
TIME_CONSTANT = 0.005  # [s] of the contact; an arm that presses with 100 m/s² then sinks in by 0.1 mm
MIN_HEIGHT_DIFFERENCE = 0.002  # [m] by which commanded poses must be lower than measured ones, so that a floor is tried


@dataclass(frozen=True, kw_only=True)
class FloorContact(Effect):
    """A rigid horizontal plane at `depth` below the axis of the first joint, which collision shapes cannot enter."""

    depth: float

    parameters: ClassVar = (Parameter("depth", "m", 0.001, 10.0, np.inf),)
    whole_arm: ClassVar = True
    per_joint: ClassVar = False
    equation: ClassVar = "lowest point of the arm ≥ height of the first joint's axis − depth"
    source: ClassVar = "Unilateral contact; MuJoCo documentation, Computation, Contact"
    signature: ClassVar = (
        "Several joints stop short of low commands, at one height, and are pushed by each other's motion."
    )
    confused_with: ClassVar = ("torque_limit", "coulomb_friction", "payload")

    @classmethod
    def guesses(cls, scales: Scales) -> tuple[Mapping[str, float], ...]:
        """The lowest measured point of the arm, if it was commanded to go lower."""
        measured, commanded = scales.depth, scales.commanded_depth
        return ({"depth": measured},) if 0 < measured < commanded - MIN_HEIGHT_DIFFERENCE else ()

    @classmethod
    def vanishing_value(cls, scales: Scales) -> float:
        """The lowest commanded point: a floor there is not touched."""
        return scales.commanded_depth

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Add the plane as a body of its own, so that excluded contacts with the model's floor stay excluded.

        Raises:
            ModelFileError: the arm has no collision shapes.
        """
        model = spec.compile()
        geoms = find_arm_geoms(model)
        if not geoms:
            raise ModelFileError("floor_contact needs an arm with collision shapes.")
        bits = int(np.bitwise_or.reduce([model.geom_contype[geom] | model.geom_conaffinity[geom] for geom in geoms]))
        enable_contacts(spec)
        body = spec.worldbody.add_body(name=make_unique_name(spec.body, NAME))
        plane = body.add_geom(name=make_unique_name(spec.geom, NAME), type=mujoco.mjtGeom.mjGEOM_PLANE)
        plane.pos, plane.size = [0.0, 0.0, find_first_anchor(model)[2] - self.depth], [0.0, 0.0, 0.1]
        plane.quat, plane.material, plane.rgba = [1.0, 0.0, 0.0, 0.0], "", [0.5, 0.5, 0.5, 0.3]
        plane.contype = plane.conaffinity = bits
        plane.solref = [max(TIME_CONSTANT, 2 * spec.option.timestep), 1.0]
