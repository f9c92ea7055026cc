"""Sealed answer of a case, as `answer.json` holds it."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from nas_data.benchmarks.blind.conditions import Conditions
from nas_data.benchmarks.blind.findings import Name
from nas_data.benchmarks.blind.truth import Base


@dataclass(frozen=True)
class HiddenEntry:
    """A hidden effect.

    Attributes:
        effect: Its name.
        joint: Its joint; None for the whole arm.
        parameters: Parameter → value.
        mark: RMS change of the position, as a multiple of the noise floor.
        marked_joint: Joint on which the mark was measured.
        equals: Other names that no recording could distinguish from it; None if there are none.
    """

    effect: str
    joint: str | None
    parameters: Mapping[str, float]
    mark: float
    marked_joint: str
    equals: tuple[Name, ...] | None = field(default=None, metadata={"optional": True})

    @property
    def name(self) -> Name:
        """Effect and joint."""
        return self.effect, self.joint


@dataclass(frozen=True)
class SealedAnswer:
    """Everything that a workflow is not given.

    Attributes:
        case: Name of the case; the following six entries are those of its `Identity`.
        arm: Name of the arm.
        joints: Names of its joints.
        excitation: Name of the command signal.
        conditions: Conditions of the recording.
        effects: Hidden effects.
        base: Factors on the model's own parameters.
    """

    case: str
    family: str
    plant: str
    number: int
    seed: int
    faint: bool
    setting: str
    arm: str
    joints: tuple[str, ...]
    excitation: str
    conditions: Conditions
    effects: tuple[HiddenEntry, ...]
    base: Base
