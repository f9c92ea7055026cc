"""Sealed answer of a case, as `answer.json` holds it."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from nas_data.benchmarks.blind.conditions import Conditions
from nas_data.benchmarks.blind.findings import Name
from nas_data.benchmarks.blind.truth import Base


@dataclass(frozen=True)
class HiddenEntry:
    """A hidden effect."""

    effect: str  # its name
    joint: str | None  # its joint; None for the whole arm
    parameters: Mapping[str, float]  # parameter → value
    mark: float  # RMS change of the position, as a multiple of the noise floor
    marked_joint: str  # joint on which the mark was measured
    # other names that no recording could distinguish from it; None if there are none
    equals: tuple[Name, ...] | None = field(default=None, metadata={"optional": True})

    @property
    def name(self) -> Name:
        """Effect and joint."""
        return self.effect, self.joint


@dataclass(frozen=True)
class SealedAnswer:
    """Everything that a workflow is not given."""

    case: str  # name of the case; the following six entries are those of its `Identity`
    family: str
    plant: str
    number: int
    seed: int
    faint: bool
    setting: str
    arm: str  # name of the arm
    joints: tuple[str, ...]  # names of its joints
    excitation: str  # name of the command signal
    conditions: Conditions  # conditions of the recording
    effects: tuple[HiddenEntry, ...]  # hidden effects
    base: Base  # factors on the model's own parameters
