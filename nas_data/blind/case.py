"""One case of the benchmark: everything in it follows from its family, plant, number and the master seed."""

import hashlib
from dataclasses import dataclass

import numpy as np

from nas_data.blind.arms import Arm
from nas_data.blind.conditions import Conditions
from nas_data.blind.truth import Truth
from nas_data.errors import UnknownName

# how many effects of the contract's table hide in a case of each family
FAMILIES = {"none": 0, "one": 1, "two": 2, "three": 3, "outside": 1}
DEFAULT = "xl320"  # setting whose cases are named without it, as they were before there were others


@dataclass(frozen=True)
class Identity:
    """What names a case.

    Attributes:
        family: One of `FAMILIES`.
        plant: What plays it.
        number: Its number in the family, from zero.
        seed: Master seed of the benchmark.
        faint: Whether effects too small to be named may hide, for the power curve.
        setting: File of `settings/` that draws it.
    """

    family: str
    plant: str
    number: int
    seed: int
    faint: bool = False
    setting: str = DEFAULT

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
    """Commands and what the plant did.

    Attributes:
        commands: Commanded positions [rad], shape (E, T, n).
        poses: Commanded before each episode [rad], shape (E, n).
        positions: Where the links were before the first command and after each [rad], shape (E, T + 1, n).
        readings: The same as the sensors reported it [rad].
        speeds: As they were reported [rad/s], shape (E, T + 1, n); None where they are to be differenced.
    """

    commands: np.ndarray
    poses: np.ndarray
    positions: np.ndarray
    readings: np.ndarray
    speeds: np.ndarray | None = None


@dataclass(frozen=True)
class Case:
    """A case with its sealed answer.

    Attributes:
        identity: What names it.
        arm: Nominal arm.
        conditions: Under what it was recorded.
        truth: What hides in the plant.
        marks: What each hidden effect does to the positions, as a multiple of the noise floor.
        marked_joints: Joint on which each mark was measured.
        recorded: Episodes that are handed over.
        fresh: Episodes that are never handed over.
    """

    identity: Identity
    arm: Arm
    conditions: Conditions
    truth: Truth
    marks: tuple[float, ...]
    marked_joints: tuple[str, ...]
    recorded: Episodes
    fresh: Episodes

    def answer(self) -> dict[str, object]:
        """Return the sealed answer."""
        effects = [
            {**hidden.to_json(), "mark": mark, "marked_joint": joint}
            for hidden, mark, joint in zip(self.truth.hidden, self.marks, self.marked_joints, strict=True)
        ]
        return {
            "case": self.identity.name,
            **vars(self.identity),
            "arm": self.arm.name,
            "joints": list(self.arm.joints),
            "excitation": self.conditions.signal,
            "conditions": self.conditions.to_json(),
            "effects": effects,
            "base": self.truth.base.to_json(),
        }
