"""A case of the benchmark, determined by family, plant, number and master seed, and its sealed answer."""

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
    """What a servo measures at its joint."""

    noise: float  # standard deviation of a position before rounding [rad]
    quantum: float  # resolution of a position [rad]; 0 for an exact one
    floor: float  # RMS error that counts as the noise floor [rad]
    # standard deviation of a measured speed [rad/s]; None where speeds are differences of positions
    speed_noise: float | None = None

    def positions(self, true: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Return measured positions [rad]: noise, then rounding."""
        noisy = true + self.noise * rng.standard_normal(true.shape)
        return np.round(noisy / self.quantum) * self.quantum if self.quantum else noisy

    def speeds(self, true: np.ndarray, rng: np.random.Generator) -> np.ndarray | None:
        """Return measured speeds [rad/s]; None if none are measured."""
        return None if self.speed_noise is None else true + self.speed_noise * rng.standard_normal(true.shape)


@dataclass(frozen=True)
class Conditions:
    """Recording conditions, the same for every episode of a case."""

    rate: float  # control rate [Hz]
    seconds: float  # length of an episode [s]
    episodes: int  # number of episodes handed over
    fresh: int  # number of episodes kept back
    settle: float  # time for which the first pose is commanded before an episode begins [s]
    signal: str  # name of the command signal
    sensor: Sensor  # what the servos report
    # number of episodes that each motion under commanded torques is cut into (they begin in motion); 0 where positions
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


BASE_SHARE = 0.1  # half range of the factors on the model's own parameters; DESIGN asks for a few to ten percent


@dataclass(frozen=True)
class Hidden:
    """One hidden effect."""

    effect: str  # its name in the contract's table, or a name outside the table
    joint: str | None  # its joint; None for the whole arm
    parameters: Mapping[str, float]  # values in the units of the table


@dataclass(frozen=True)
class Base:
    """Factors on the nominal model's own parameters, one per link or joint."""

    mass: tuple[float, ...]  # on mass and inertia of each moving link
    damping: tuple[float, ...]  # on joint damping and the servo's damping together
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
    """All differences between a plant and its nominal model."""

    base: Base  # factors on the model's own parameters
    hidden: tuple[Hidden, ...] = ()  # effects that the model lacks

    def without(self, index: int) -> "Truth":
        """Return the truth without one hidden effect."""
        return replace(self, hidden=self.hidden[:index] + self.hidden[index + 1 :])


@dataclass(frozen=True)
class CommandSequence:
    """Commands of E episodes of n joints."""

    commands: np.ndarray  # positions [rad] or torques [N m], shape (E, T, n)
    poses: np.ndarray  # pose commanded before each episode, or its first pose [rad], shape (E, n)
    # first velocities [rad/s], shape (E, n); None for rest
    start_speeds: np.ndarray | None = None

    def __getitem__(self, episodes: slice) -> "CommandSequence":
        """Return some of the episodes."""
        speeds = None if self.start_speeds is None else self.start_speeds[episodes]
        return CommandSequence(self.commands[episodes], self.poses[episodes], speeds)


# plant, truth → commands to play; a controller's commands depend on both
Script = Callable[[str, Truth], CommandSequence]


@dataclass(frozen=True)
class HiddenEntry:
    """A hidden effect."""

    effect: str  # its name
    joint: str | None  # its joint; None for the whole arm
    parameters: Mapping[str, float]  # parameter → value
    mark: float  # RMS change of the position, as a multiple of the noise floor
    marked_joint: str  # joint at which the mark was measured
    # other names that no recording could distinguish from it; None if there are none
    equals: tuple[Name, ...] | None = field(default=None, metadata={"optional": True})
    # joints on which it acts by at least `FELT`; None for an effect of the contract's table
    felt_joints: tuple[str, ...] | None = field(default=None, metadata={"optional": True})

    @property
    def name(self) -> Name:
        """Effect and joint."""
        return self.effect, self.joint


@dataclass(frozen=True)
class SealedAnswer:
    """Everything that is withheld from a workflow."""

    case: str  # name of the case; the next six fields are those of its `Identity`
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


FELT = 3.0  # multiples of the noise floor from which an effect is felt at a joint
EVERY = "every"  # family in which one effect is hidden in every joint


@dataclass(frozen=True)
class CaseFamily:
    """Number of effects that are hidden in a case."""

    inside: int  # of the contract's table
    outside: int = 0  # not in the table


FAMILIES = {
    "none": CaseFamily(0), "one": CaseFamily(1), "two": CaseFamily(2), "three": CaseFamily(3), EVERY: CaseFamily(1),
    "outside": CaseFamily(0, 1), "outside_one": CaseFamily(1, 1), "outside_two": CaseFamily(2, 1),
}  # fmt: skip
ALIKE = 1e-6  # gravity torque of an axis that counts as unloaded, relative to the torque limit
DEFAULT = "xl320"  # setting that case names leave out


@dataclass(frozen=True)
class Identity:
    """Everything that determines a case."""

    family: str  # one of `FAMILIES`
    plant: str  # plant that plays it
    number: int  # its number in the family, from zero
    seed: int  # master seed of the benchmark
    faint: bool = False  # whether effects too small to be named may be hidden, for the power curve
    setting: str = DEFAULT  # file of `settings/` that draws it

    def __post_init__(self) -> None:
        if self.family not in FAMILIES:
            raise UnknownName("family", self.family, FAMILIES)

    @property
    def name(self) -> str:
        """Name of the case's folder."""
        sort = f"{'power-' if self.faint else ''}{'' if self.setting == DEFAULT else f'{self.setting}-'}"
        return f"{sort}{self.family}-{self.plant}-{self.seed}-{self.number:04d}"

    def stream(self, purpose: str) -> np.random.Generator:
        """Return an independent random generator for one purpose, seeded by SHA-256."""
        digest = hashlib.sha256(f"{self.name}/{purpose}".encode()).digest()
        return np.random.default_rng(np.frombuffer(digest, np.uint32).tolist())


@dataclass(frozen=True)
class Episodes:
    """Commands and the plant's motion."""

    commands: np.ndarray  # commanded positions [rad] or torques [N m], shape (E, T, n)
    poses: np.ndarray  # pose commanded before each episode, or its first pose [rad], shape (E, n)
    positions: np.ndarray  # true positions before the first command and after each [rad], shape (E, T + 1, n)
    readings: np.ndarray  # measured positions [rad], shape (E, T + 1, n)
    # measured speeds [rad/s], shape (E, T + 1, n); None if they are to be differences of positions
    speeds: np.ndarray | None = None
    # true speeds before the first command [rad/s], shape (E, n); None for rest
    start_speeds: np.ndarray | None = None

    @property
    def starts(self) -> np.ndarray:
        """Initial states for a prediction, positions [rad] then speeds [rad/s], shape (E, 2n).

        These are the first readings at rest. Episodes that begin in motion start from the true state: under torque
        commands an initial error persists, and the model is to be judged, not the initial state.
        """
        if self.start_speeds is None:
            return np.concatenate([self.readings[:, 0], np.zeros_like(self.poses)], axis=1)
        return np.concatenate([self.positions[:, 0], self.start_speeds], axis=1)


@dataclass(frozen=True)
class Case:
    """A case with its sealed answer."""

    identity: Identity  # what names it
    arm: NominalArm  # nominal arm
    conditions: Conditions  # recording conditions
    truth: Truth  # hidden effects and base errors of the plant
    marks: tuple[float, ...]  # RMS change of the positions by each hidden effect, as a multiple of the noise floor
    marked_joints: tuple[str, ...]  # joint at which each mark was measured
    felt_joints: tuple[tuple[str, ...] | None, ...]  # joints on which each acts; None for an effect of the table
    recorded: Episodes  # episodes that are handed over
    fresh: Episodes  # episodes that are never handed over

    def answer(self) -> SealedAnswer:
        """Return the sealed answer."""
        constants = Constants.of(self.arm.model())
        effects = tuple(
            HiddenEntry(
                **vars(hidden),
                mark=mark,
                marked_joint=joint,
                equals=find_equivalents(constants, hidden),
                felt_joints=felt,
            )
            for hidden, mark, joint, felt in zip(
                self.truth.hidden, self.marks, self.marked_joints, self.felt_joints, strict=True
            )
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
    """Return other names that no recording could distinguish from a hidden effect; None if there are none.

    On a single axis without gravity load, a payload and a rotor inertia have the same effect.
    """
    if len(constants.joints) > 1 or hidden.effect not in ("payload", "rotor_inertia") or has_gravity_load(constants):
        return None
    return (("rotor_inertia", constants.joints[0]),) if hidden.effect == "payload" else (("payload", None),)


def has_gravity_load(constants: Constants) -> bool:
    """Whether gravity acts on the joint of an arm of one joint."""
    axis = constants.turns[0] @ constants.axes[0]
    weight = constants.masses[0] * constants.gravity
    along, across = weight @ axis, np.linalg.norm(np.cross(axis, weight))
    return bool(abs(along if constants.sliding[0] else across) > ALIKE * constants.force[0, 1])
