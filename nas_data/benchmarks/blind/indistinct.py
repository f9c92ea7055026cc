"""Names that no recording of an arm could tell from what hides in it: each is as right as the other."""

import numpy as np

from nas_data.benchmarks.blind.findings import Name
from nas_data.benchmarks.blind.plants.constants import Constants
from nas_data.benchmarks.blind.truth import Hidden

ALIKE = 1e-6  # of the torque limit: the torque of gravity on an axis that it does not load


def equals_of(constants: Constants, hidden: Hidden) -> list[Name]:
    """Return the other names of a hidden effect.

    On a single axis that gravity does not load, what is carried and what the rotor adds are one inertia.
    """
    if len(constants.joints) > 1 or hidden.effect not in ("payload", "rotor_inertia") or gravity_acts(constants):
        return []
    return [("rotor_inertia", constants.joints[0])] if hidden.effect == "payload" else [("payload", None)]


def gravity_acts(constants: Constants) -> bool:
    """Whether gravity acts along a slide's axis, or turns a hinge, of an arm of one joint."""
    axis = constants.turns[0] @ constants.axes[0]
    weight = constants.masses[0] * constants.gravity
    along, across = weight @ axis, np.linalg.norm(np.cross(axis, weight))
    return bool(abs(along if constants.sliding[0] else across) > ALIKE * constants.force[0, 1])
