"""What is hidden in a plant: effects with their sizes, and base parameters that are a few percent off the model's."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

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
