"""Mass of objects that differs from the model's."""

from dataclasses import dataclass
from typing import ClassVar

import mujoco

from nas_data.effects.base import Effect, Parameter
from nas_data.effects.edits.objects import find_objects


@dataclass(frozen=True, kw_only=True)
class ObjectMass(Effect):
    """One factor on mass and inertia of all objects in the scene."""

    factor: float

    parameters: ClassVar = (Parameter("factor", "", 0.1, 10.0, 1.0),)
    whole_arm: ClassVar = True
    per_joint: ClassVar = False
    equation: ClassVar = "mass = factor · the model's, inertia likewise"
    source: ClassVar = "Rigid-body mechanics"
    signature: ClassVar = (
        "The object leaves slower when hit, and slides as far as its speed lets it; the arm yields more."
    )
    confused_with: ClassVar = ("object_friction", "torque_limit")

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Scale the explicit inertia of the objects' bodies, and mass and density of their geoms.

        Raises:
            ModelFileError: the model has no object.
        """
        for index in find_objects(spec.compile(), self.name()):
            body = spec.bodies[index]
            body.mass, body.inertia = body.mass * self.factor, body.inertia * self.factor
            body.fullinertia = body.fullinertia * self.factor
            for geom in body.geoms:
                geom.mass, geom.density = geom.mass * self.factor, geom.density * self.factor
