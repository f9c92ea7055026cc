"""A case of the benchmark, which follows from family, plant, number and master seed, and its sealed answer."""

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from nas_data.benchmarks.blind.arms import NominalArm
from nas_data.benchmarks.blind.plants.constants import Constants
from nas_data.errors import UnknownName

Name = tuple[str, str | None]  # effect, joint; None for the whole arm


@dataclass(frozen=True)
class Sensor:
    """What a servo reports of its joint."""

    noise: float  # standard deviation of a position before rounding [rad]
    quantum: float  # resolution of a position [rad]; 0 for an exact one
    floor: float  # what of it counts as the noise floor [rad]
    # standard deviation of a measured speed [rad/s]; None where speeds are differences of positions
    speed_noise: float | None = None

    def positions(self, true: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Return reported positions [rad]: noise, then rounding."""
        noisy = true + self.noise * rng.standard_normal(true.shape)
        return np.round(noisy / self.quantum) * self.quantum if self.quantum else noisy

    def speeds(self, true: np.ndarray, rng: np.random.Generator) -> np.ndarray | None:
        """Return reported speeds [rad/s]; None where none is measured."""
        return None if self.speed_noise is None else true + self.speed_noise * rng.standard_normal(true.shape)


@dataclass(frozen=True)
class Conditions:
    """What holds for every episode of a case."""

    rate: float  # control rate [Hz]
    seconds: float  # length of an episode [s]
    episodes: int  # how many are handed over
    fresh: int  # how many are kept back
    settle: float  # for how long the first pose is commanded before an episode begins [s]
    signal: str  # name of the command signal
    sensor: Sensor  # what the servos report
    # into how many episodes each motion under commanded torques is cut, all of which begin in motion; 0 where positions
    # are commanded and episodes begin at rest
    pieces: int = 0

    @property
    def period(self) -> float:
        """Control period [s]."""
        return 1 / self.rate

    @property
    def steps(self) -> int:
        """Control periods in an episode."""
        return round(self.seconds * self.rate)


BASE_SHARE = 0.1  # half range of the factors on the model's own parameters: DESIGN says a few to ten percent


@dataclass(frozen=True)
class Hidden:
    """One hidden effect."""

    effect: str  # its name, as the contract's table has it, or one of those outside the table
    joint: str | None  # joint that it sits in; None where it belongs to the whole arm
    parameters: Mapping[str, float]  # values in the units of the table


@dataclass(frozen=True)
class Base:
    """Factors on the parameters that the model has, one a link or joint."""

    mass: tuple[float, ...]  # on mass and inertia of each moving link
    damping: tuple[float, ...]  # on joint damping and the servo's own, together
    armature: tuple[float, ...]  # on the rotors' reflected inertia
    stiffness: tuple[float, ...]  # on the position gains

    @classmethod
    def nominal(cls, joints: int) -> "Base":
        """Return factors of one."""
        ones = (1.0,) * joints
        return cls(ones, ones, ones, ones)

    @classmethod
    def draw(cls, joints: int, rng: np.random.Generator) -> "Base":
        """Draw each factor uniformly."""
        drawn = rng.uniform(1 - BASE_SHARE, 1 + BASE_SHARE, (4, joints)).tolist()
        return cls(*(tuple(row) for row in drawn))


@dataclass(frozen=True)
class Truth:
    """Everything in which a plant differs from its nominal model."""

    base: Base  # factors on the model's own parameters
    hidden: tuple[Hidden, ...] = ()  # effects that the model lacks

    def without(self, index: int) -> "Truth":
        """Return the truth with one hidden effect taken away."""
        return replace(self, hidden=self.hidden[:index] + self.hidden[index + 1 :])


@dataclass(frozen=True)
class CommandSequence:
    """Commands of E episodes of n joints."""

    commands: np.ndarray  # positions [rad] or torques [N m], shape (E, T, n)
    poses: np.ndarray  # commanded before each episode, or where it begins [rad], shape (E, n)
    # how fast the links are when it begins [rad/s], shape (E, n); None where they rest
    start_speeds: np.ndarray | None = None

    def __getitem__(self, episodes: slice) -> "CommandSequence":
        """Return some of the episodes."""
        speeds = None if self.start_speeds is None else self.start_speeds[episodes]
        return CommandSequence(self.commands[episodes], self.poses[episodes], speeds)


# plant, truth → what is played; a controller's commands depend on both
Script = Callable[[str, Truth], CommandSequence]


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
