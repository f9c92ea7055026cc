"""Assignment of state and action components to joints, for any naming scheme."""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import ACTION, EFFORT, POSITION, STATE, VELOCITY, Feature, are_generated
from nas_data.errors import DatasetInvalid, JointMismatch

LARGEST_ANGLE = 4 * np.pi  # [rad] two turns; servos and arms stay below, degrees exceed it
LARGEST_LENGTH = 10.0  # [m] slides of arms stay below, millimetres exceed it
# Common spellings of the units of hinges and slides; the first one is the contract's.
ANGULAR = {POSITION: ("rad",), VELOCITY: ("rad/s",), EFFORT: ("N·m", "N*m", "N m", "Nm")}
LINEAR = {POSITION: ("m",), VELOCITY: ("m/s",), EFFORT: ("N",)}
SERVO_RESOLUTION = 4096  # [ticks per turn] of the servos that LeRobot's arms have
MIN_READINGS = 8  # distinct multiples of a step needed to find it
GRID_TOLERANCE = 0.03  # [ticks] tolerance of the grid; float32 resolves a thousandth of a tick
REMEDY = "import it with a map that gives the unit (nas import --map)"
NAMES = "import it with a map that gives the joints (nas import --map)"
SAME_NAMES = "name the same joints in both, or name them in a map (nas import --map)"


@dataclass(frozen=True)
class Components:
    """Indices of positions, velocities and torques in a feature.

    Attributes:
        positions: Joint → component.
        velocities: Joint → component.
        efforts: Joint → component.
    """

    positions: Mapping[str, int]
    velocities: Mapping[str, int]
    efforts: Mapping[str, int]

    @classmethod
    def of(cls, key: str, feature: Feature) -> "Components":
        """Read the names of a feature: `<joint>.pos`, `.vel`, `.effort`, or the bare joints for positions.

        Raises:
            JointMismatch: the components have no names.
        """
        if are_generated(key, feature.names):
            raise JointMismatch(f"The components of '{key}' have no joint names; {NAMES}.")
        found: dict[str, dict[str, int]] = {POSITION: {}, VELOCITY: {}, EFFORT: {}}
        bare = {}
        for index, name in enumerate(feature.names):
            suffix = next((suffix for suffix in found if name.endswith(suffix)), None)
            if suffix is None:
                bare[name] = index
            else:
                found[suffix][name.removesuffix(suffix)] = index
        if not any(found.values()):
            found[POSITION] = bare
        return cls(found[POSITION], found[VELOCITY], found[EFFORT])

    def commanded(self) -> dict[str, tuple[str, int]]:
        """Return command type and component of each joint; a torque takes precedence, then a position."""
        kinds = {VELOCITY: self.velocities, POSITION: self.positions, EFFORT: self.efforts}
        return {joint: (kind, index) for kind, places in kinds.items() for joint, index in places.items()}


def check_units(dataset: Dataset, key: str, components: Components, slides: Collection[str]) -> bool:
    """Refuse units other than SI: radians for hinges, metres for slides.

    A stored unit is trusted, because a joint may make several turns. Without one, values too large for radians are
    refused, and readings that are whole ticks of a servo in degrees.

    Args:
        dataset: The dataset.
        key: Feature to check.
        components: Components of the feature.
        slides: Names of the slide joints; see `find_slides`.

    Returns:
        Whether units are stored; otherwise radians are assumed.

    Raises:
        DatasetInvalid: names the joint, the value or unit, and the remedy.
    """
    feature, column = dataset.features[key], dataset.columns[key]
    kinds = {POSITION: components.positions, VELOCITY: components.velocities, EFFORT: components.efforts}
    for suffix, places in kinds.items():
        for joint, index in places.items():
            unit = feature.units[index] if feature.units else ""
            known = (LINEAR if joint in slides else ANGULAR)[suffix]
            if unit and unit not in known:
                other = "" if joint in slides else f", or {LINEAR[suffix][0]} for a slide"
                raise DatasetInvalid(f"'{key}' of joint {joint} is in {unit}, {known[0]} is needed{other}; {REMEDY}.")
    for joint, index in components.positions.items():
        largest = float(np.abs(column[:, index]).max(initial=0.0))
        most, what = (
            (LARGEST_LENGTH, "metres (millimetres?)")
            if joint in slides
            else (LARGEST_ANGLE, "radians (degrees or servo units?)")
        )
        if largest > most and not feature.units:
            raise DatasetInvalid(f"'{key}' of joint {joint} reaches {largest:.4g}, which cannot be {what}; {REMEDY}.")
        if not feature.units and any(is_on_grid(column[:, index], step) for step in list_degree_steps()):
            raise DatasetInvalid(
                f"the values of '{key}' of joint {joint} are multiples of {360 / SERVO_RESOLUTION:.4f}, as of a servo "
                f"that is read in degrees; {REMEDY}."
            )
    return bool(feature.units)


def list_degree_steps(resolution: int = SERVO_RESOLUTION) -> tuple[float, float]:
    """Return a servo's tick in degrees, by LeRobot and by its first versions (see `importing/calibration.py`)."""
    return 360 / (resolution - 1), 360 / resolution


def is_on_grid(values: np.ndarray, step: float) -> bool | None:
    """Return whether readings are multiples of a step apart; None if too few multiples differ."""
    different = np.unique(values)
    counts = (different - different[:1]) / step
    if len(np.unique(np.round(counts))) < MIN_READINGS:
        return None
    return bool((np.abs(counts - np.round(counts)) < GRID_TOLERANCE).all())


def list_joints(feature: Feature) -> tuple[str, ...]:
    """Return the joints of a state, whose positions may have bare names; empty if the components have no names."""
    return () if are_generated(STATE, feature.names) else tuple(Components.of(STATE, feature).positions)


def is_gripper(name: str) -> bool:
    """Return whether a joint or component is a gripper by its name; LeRobot gives 0 … 100 of its range."""
    return "gripper" in name.lower()


def find_slides(feature: Feature, components: Components) -> frozenset[str]:
    """Return the slide joints of a state: those with positions in metres."""
    if not feature.units:
        return frozenset()
    places = components.positions.items()
    return frozenset(joint for joint, index in places if feature.units[index] in LINEAR[POSITION])


def match_joints(state: Components, action: Components) -> tuple[str, ...]:
    """Return the joints in the state's order.

    Raises:
        JointMismatch: state and action name different joints, or some have no position.
    """
    joints = tuple(state.positions)
    commanded = action.commanded()
    if not joints or set(commanded) != set(joints) or (state.velocities and set(state.velocities) != set(joints)):
        raise JointMismatch(
            f"'{STATE}' has positions of {_join_names(state.positions)}"
            + (f" and velocities of {_join_names(state.velocities)}" if state.velocities else "")
            + f", '{ACTION}' commands {_join_names(commanded)}; {SAME_NAMES}."
        )
    return joints


def _join_names(names: Iterable[str]) -> str:
    return ", ".join(names) or "no joint"
