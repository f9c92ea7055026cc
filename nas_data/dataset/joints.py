"""Which component of a state or action belongs to which joint, whoever named them."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import ACTION, EFFORT, POSITION, STATE, VELOCITY, Feature
from nas_data.errors import DatasetInvalid, JointMismatch

LARGEST_ANGLE = 4 * np.pi  # [rad] two turns; no servo's or arm's joint goes further, degrees do at once
UNITS = {POSITION: {"rad"}, VELOCITY: {"rad/s"}, EFFORT: {"N·m", "N*m", "N m", "Nm"}}
REMEDY = "import it with a map that gives the unit (nas import --map)"


@dataclass(frozen=True)
class Components:
    """Where a feature keeps the positions, velocities and torques of its joints.

    Attributes:
        positions: Joint → component.
        velocities: Joint → component.
        efforts: Joint → component.
        others: Names of the components that are none of these.
    """

    positions: Mapping[str, int]
    velocities: Mapping[str, int]
    efforts: Mapping[str, int]
    others: tuple[str, ...]

    @classmethod
    def of(cls, key: str, feature: Feature) -> "Components":
        """Read the names of a feature: `<joint>.pos`, `.vel`, `.effort`, or the bare joints for positions.

        Raises:
            JointMismatch: the components have no names.
        """
        if all(name == key or name.startswith(f"{key}.") for name in feature.names):
            raise JointMismatch(f"The components of '{key}' have no joint names; {REMEDY.replace('unit', 'joints')}.")
        found: dict[str, dict[str, int]] = {POSITION: {}, VELOCITY: {}, EFFORT: {}}
        bare = {}
        for place, name in enumerate(feature.names):
            suffix = next((suffix for suffix in found if name.endswith(suffix)), None)
            if suffix is None:
                bare[name] = place
            else:
                found[suffix][name.removesuffix(suffix)] = place
        if not found[POSITION] and not found[EFFORT]:
            found[POSITION], bare = bare, {}
        return cls(found[POSITION], found[VELOCITY], found[EFFORT], tuple(bare))


def check_radians(dataset: Dataset, key: str, components: Components) -> bool:
    """Refuse angles that are not in radians. Where the unit is stored it is believed: a joint may make several turns.

    Returns:
        Whether the units are stored; where they are not, radians are assumed.

    Raises:
        DatasetInvalid: names the joint, the value or unit, and the remedy.
    """
    feature, column = dataset.features[key], dataset.columns[key]
    kinds = {POSITION: components.positions, VELOCITY: components.velocities, EFFORT: components.efforts}
    for suffix, places in kinds.items():
        for joint, place in places.items():
            unit = feature.units[place] if feature.units else ""
            if unit and unit not in UNITS[suffix]:
                wanted = min(UNITS[suffix], key=len)
                raise DatasetInvalid(f"'{key}' of joint {joint} is in {unit}, {wanted} is needed; {REMEDY}.")
    for joint, place in components.positions.items():
        largest = float(np.abs(column[:, place]).max(initial=0.0))
        if largest > LARGEST_ANGLE and not feature.units:
            raise DatasetInvalid(
                f"'{key}' of joint {joint} reaches {largest:.4g}, which cannot be radians (degrees or servo units?); "
                f"{REMEDY}."
            )
    return bool(feature.units)


def matching_joints(state: Components, action: Components) -> tuple[str, ...]:
    """Return the joints in the state's order.

    Raises:
        JointMismatch: state and action name different joints, or some have no position.
    """
    joints = tuple(state.positions)
    commanded = action.efforts or action.positions
    if not joints or set(commanded) != set(joints) or (state.velocities and set(state.velocities) != set(joints)):
        raise JointMismatch(
            f"'{STATE}' has positions of {_listed(state.positions)}"
            + (f" and velocities of {_listed(state.velocities)}" if state.velocities else "")
            + f", '{ACTION}' commands {_listed(commanded)}; they must name the same joints."
        )
    return joints


def _listed(names: Mapping[str, int]) -> str:
    return ", ".join(names) or "no joint"
