"""One case of the benchmark: everything in it follows from its family, plant, number and the master seed."""

import hashlib
from dataclasses import dataclass

import numpy as np

from nas_data.benchmarks.blind.answer import HiddenEntry, SealedAnswer
from nas_data.benchmarks.blind.arms import NominalArm
from nas_data.benchmarks.blind.conditions import Conditions
from nas_data.benchmarks.blind.findings import Name
from nas_data.benchmarks.blind.plants.constants import Constants
from nas_data.benchmarks.blind.truth import Hidden, Truth
from nas_data.errors import UnknownName

EVERY = "every"  # family whose effect hides in every joint
# how many effects of the contract's table hide in a case of each family
FAMILIES = {"none": 0, "one": 1, "two": 2, "three": 3, "outside": 1, EVERY: 1}
ALIKE = 1e-6  # of the torque limit: gravity torque on an axis that gravity does not load
DEFAULT = "xl320"  # setting whose cases are named without it, as they were before there were others


@dataclass(frozen=True)
class Identity:
    """What names a case."""

    family: str  # one of `FAMILIES`
    plant: str  # what plays it
    number: int  # its number in the family, from zero
    seed: int  # master seed of the benchmark
    faint: bool = False  # whether effects too small to be named may hide, for the power curve
    setting: str = DEFAULT  # file of `settings/` that draws it

    def __post_init__(self) -> None:
        if self.family not in FAMILIES:
            raise UnknownName("family", self.family, FAMILIES)

    @property
    def name(self) -> str:
        """Name of its folder."""
        sort = f"{'power-' if self.faint else ''}{'' if self.setting == DEFAULT else f'{self.setting}-'}"
        return f"{sort}{self.family}-{self.plant}-{self.seed}-{self.number:04d}"

    def stream(self, purpose: str) -> np.random.Generator:
        """Return a source of randomness of its own for one purpose, by SHA-256."""
        digest = hashlib.sha256(f"{self.name}/{purpose}".encode()).digest()
        return np.random.default_rng(np.frombuffer(digest, np.uint32).tolist())


@dataclass(frozen=True)
class Episodes:
    """Commands and what the plant did."""

    commands: np.ndarray  # commanded positions [rad] or torques [N m], shape (E, T, n)
    poses: np.ndarray  # commanded before each episode, or where it begins [rad], shape (E, n)
    positions: np.ndarray  # where the links were before the first command and after each [rad], shape (E, T + 1, n)
    readings: np.ndarray  # the same as the sensors reported it [rad]
    # as they were reported [rad/s], shape (E, T + 1, n); None where they are to be differenced
    speeds: np.ndarray | None = None
    # how fast the links were before the first command [rad/s], shape (E, n); None where they rested
    start_speeds: np.ndarray | None = None

    @property
    def starts(self) -> np.ndarray:
        """Where who plays an episode starts, positions [rad] then speeds [rad/s], shape (E, 2n).

        At the first reading, at rest; where the episode began in motion, at what was true: an error of the start would
        stay, for no position is commanded, and the model is judged, not the start.
        """
        if self.start_speeds is None:
            return np.concatenate([self.readings[:, 0], np.zeros_like(self.poses)], axis=1)
        return np.concatenate([self.positions[:, 0], self.start_speeds], axis=1)


@dataclass(frozen=True)
class Case:
    """A case with its sealed answer."""

    identity: Identity  # what names it
    arm: NominalArm  # nominal arm
    conditions: Conditions  # under what it was recorded
    truth: Truth  # what hides in the plant
    marks: tuple[float, ...]  # what each hidden effect does to the positions, as a multiple of the noise floor
    marked_joints: tuple[str, ...]  # joint on which each mark was measured
    recorded: Episodes  # episodes that are handed over
    fresh: Episodes  # episodes that are never handed over

    def answer(self) -> SealedAnswer:
        """Return the sealed answer."""
        constants = Constants.of(self.arm.model())
        effects = tuple(
            HiddenEntry(**vars(hidden), mark=mark, marked_joint=joint, equals=find_equivalents(constants, hidden))
            for hidden, mark, joint in zip(self.truth.hidden, self.marks, self.marked_joints, strict=True)
        )
        return SealedAnswer(
            case=self.identity.name,
            **vars(self.identity),
            arm=self.arm.name,
            joints=self.arm.joints,
            excitation=self.conditions.signal,
            conditions=self.conditions,
            effects=effects,
            base=self.truth.base,
        )


def find_equivalents(constants: Constants, hidden: Hidden) -> tuple[Name, ...] | None:
    """Return other names of a hidden effect that no recording could distinguish from it; None if there are none.

    On a single axis that gravity does not load, a payload and a rotor inertia are one inertia.
    """
    if len(constants.joints) > 1 or hidden.effect not in ("payload", "rotor_inertia") or has_gravity_load(constants):
        return None
    return (("rotor_inertia", constants.joints[0]),) if hidden.effect == "payload" else (("payload", None),)


def has_gravity_load(constants: Constants) -> bool:
    """Whether gravity acts along a slide's axis, or turns a hinge, of an arm of one joint."""
    axis = constants.turns[0] @ constants.axes[0]
    weight = constants.masses[0] * constants.gravity
    along, across = weight @ axis, np.linalg.norm(np.cross(axis, weight))
    return bool(abs(along if constants.sliding[0] else across) > ALIKE * constants.force[0, 1])
