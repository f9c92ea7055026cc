"""Sliding friction of objects that differs from the model's."""

from dataclasses import dataclass
from typing import ClassVar

import mujoco

from nas_data.effects.base import Effect, Parameter
from nas_data.effects.edits.objects import add_contact, can_collide, find_objects, find_partners
from nas_data.mjcf.unique_name import make_unique_name


@dataclass(frozen=True, kw_only=True)
class ObjectFriction(Effect):
    """One factor on the sliding friction of all contacts of objects in the scene.

    In MuJoCo the larger friction of two geoms counts, so that a geom's friction does not determine the contact's.
    Therefore each possible contact of an object becomes an explicit pair.
    """

    factor: float

    parameters: ClassVar = (Parameter("factor", "", 0.1, 10.0, 1.0),)
    whole_arm: ClassVar = True
    per_joint: ClassVar = False
    equation: ClassVar = "μ = factor · the model's"
    source: ClassVar = "Coulomb's law; MuJoCo documentation, Computation, Contact, and XML reference, contact/pair"
    signature: ClassVar = "The object leaves as fast when hit, and slides less far; it is dragged and tipped more."
    confused_with: ClassVar = ("object_mass",)

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Add explicit contact pairs with scaled friction for the objects.

        Raises:
            ModelFileError: the model has no object.
        """
        model = spec.compile()
        bodies = find_objects(model, self.name())
        geoms = [geom for geom in range(model.ngeom) if model.geom_bodyid[geom] in bodies and can_collide(model, geom)]
        for index in {*geoms, *(other for geom in geoms for other in find_partners(model, geom))}:
            spec.geoms[index].name = spec.geoms[index].name or make_unique_name(spec.geom, f"geom{index}")
        written = {frozenset((pair.geomname1, pair.geomname2)): pair for pair in spec.pairs}
        for first in geoms:
            for second in find_partners(model, first):
                names = (spec.geoms[first].name, spec.geoms[second].name)
                if frozenset(names) not in written:
                    written[frozenset(names)] = add_contact(spec, model, first, second)
        own = {spec.geoms[index].name for index in geoms}
        for key, pair in written.items():
            if key & own:
                pair.friction = [*(self.factor * pair.friction[:2]), *pair.friction[2:]]
