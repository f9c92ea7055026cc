"""The numbers that a fit may move, effects' parameters and base factors, as one vector without units."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nas_data.effects.base import Effect, Parameter, make_effect
from nas_data.gap.base import WIDEST, BaseParameter

STEP = 0.02  # finite difference in a logarithm: well above what contacts and friction make rough
SIGNED_SCALE = 0.05  # [rad] offsets and tilts are in units of this
DECADES = math.log(1000.0)  # how far a positive parameter may wander from its first guess, within its bounds


@dataclass(frozen=True)
class Unknown:
    """One parameter of one effect as a number around zero.

    Attributes:
        place: Which effect of the hypothesis.
        parameter: Which of its parameters.
        start: Value at number 0: the first guess, or the neutral value where the prior is centred there.
    """

    place: int
    parameter: Parameter
    start: float

    @property
    def signed(self) -> bool:
        """Whether the parameter can have either sign; others are fitted as logarithms."""
        return self.parameter.low < 0

    @property
    def weight(self) -> float:
        """One over the standard deviation of what is plausible, 0 where nothing is known."""
        return SIGNED_SCALE / self.parameter.spread if self.parameter.spread else 0.0

    def value(self, number: float) -> float:
        """Return the parameter's value for the fitted number."""
        factor = math.exp(min(max(number, -DECADES), DECADES))
        value = self.start + SIGNED_SCALE * number if self.signed else self.start * factor
        return float(np.clip(value, self.parameter.low, self.parameter.high))

    def bounds(self) -> tuple[float, float]:
        """Return between which numbers the parameter stays within its bounds."""
        low, high = self.parameter.low, self.parameter.high
        if self.signed:
            return (low - self.start) / SIGNED_SCALE, (high - self.start) / SIGNED_SCALE
        lowest = math.log(low / self.start) if low > 0 else -DECADES
        return max(lowest, -DECADES), min(math.log(high / self.start), DECADES)


@dataclass(frozen=True)
class Unknowns:
    """A hypothesis: effects whose parameters are sought, on a base whose parameters are sought too.

    Attributes:
        effects: Effects at their first guesses.
        base: Base parameters that may move.
    """

    effects: tuple[Effect, ...]
    base: tuple[BaseParameter, ...]

    @property
    def sought(self) -> tuple[Unknown, ...]:
        """The effects' parameters, in order; details where any is not neutral."""
        return tuple(
            Unknown(place, parameter, parameter.neutral if parameter.spread else float(getattr(effect, parameter.name)))
            for place, effect in enumerate(self.effects)
            for parameter in effect.sought
        )

    @property
    def size(self) -> int:
        """How many numbers are fitted."""
        return len(self.sought) + len(self.base)

    def effects_at(self, numbers: np.ndarray) -> tuple[Effect, ...]:
        """Return the effects for fitted numbers, shape (size,)."""
        values: list[dict[str, float]] = [{} for _ in self.effects]
        for unknown, number in zip(self.sought, numbers, strict=False):
            values[unknown.place][unknown.parameter.name] = unknown.value(float(number))
        return tuple(
            make_effect(effect.name(), effect.joint, found) for effect, found in zip(self.effects, values, strict=True)
        )

    def factors_at(self, numbers: np.ndarray) -> dict[str, float]:
        """Return the base factors for fitted numbers, by name."""
        logs = numbers[len(self.sought) :]
        return {parameter.name: math.exp(float(log)) for parameter, log in zip(self.base, logs, strict=True)}

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the lowest and highest numbers, shape (size,)."""
        pairs = [unknown.bounds() for unknown in self.sought] + [(-WIDEST, WIDEST)] * len(self.base)
        low, high = np.array(pairs).reshape(-1, 2).T
        return low, high

    def prior(self, numbers: np.ndarray) -> np.ndarray:
        """Return each number's weight in the prior, one over its standard deviation, shape (size,)."""
        logs = numbers[len(self.sought) :]
        base = [1 / parameter.tolerance(float(log)) for parameter, log in zip(self.base, logs, strict=True)]
        return np.array([unknown.weight for unknown in self.sought] + base)

    def start(self, factors: dict[str, float] | None = None) -> np.ndarray:
        """Return the numbers of the first guess, with base factors where given, shape (size,)."""
        guesses = [(getattr(self.effects[u.place], u.parameter.name), u) for u in self.sought]
        sought = [(float(value) - u.start) / SIGNED_SCALE if u.parameter.spread else 0.0 for value, u in guesses]
        logs = [math.log((factors or {}).get(parameter.name, 1.0)) for parameter in self.base]
        return np.array(sought + logs)


def free_base(base: Sequence[BaseParameter], effects: Sequence[Effect]) -> tuple[BaseParameter, ...]:
    """Return the base parameters that stay free beside effects: not those that an effect replaces."""
    taken = {f"{effect.joint}.{effect.replaces}" for effect in effects if effect.replaces}
    return tuple(parameter for parameter in base if parameter.name not in taken)
