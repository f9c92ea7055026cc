"""The numbers that a fit may move: parameters of effects and of the model, as one vector θ without units."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from nas_data.effects.base import Effect, Parameter, make_effect
from nas_data.gap.nominal_parameters import NominalParameter

STEP = 0.02  # finite difference in a logarithm: well above what contacts and friction make rough
SIGNED_SCALE = 0.05  # [rad] offsets and tilts are in units of this
FREED_ONLY = ("limit",)  # kinds that do not move unless freed: what models say of them is a rating, not a measurement
DECADES = math.log(1000.0)  # how far a positive parameter may wander from its first guess, within its bounds

Label = tuple[str | None, ...]


@dataclass(frozen=True)
class FreeParameter:
    """One parameter of one effect, or of the same effect in several joints, as a number around zero.

    Attributes:
        places: Which effects of the hypothesis have it.
        parameter: Which of their parameters.
        start: Value at number 0: the first guess, or the neutral value where the prior is centred there.
    """

    places: tuple[int, ...]
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
class FreeParameters:
    """What a fit moves: parameters of effects, then those of the model.

    Attributes:
        effects: Effects at their first guesses.
        base: Parameters of the model that may move.
        shared: Names of effects whose parameters all joints have alike.
    """

    effects: tuple[Effect, ...]
    base: tuple[NominalParameter, ...]
    shared: frozenset[str] = frozenset()

    @cached_property
    def of_effects(self) -> tuple[FreeParameter, ...]:
        """The effects' parameters, in order; details where any is not neutral."""
        found = []
        for place, effect in enumerate(self.effects):
            alike = self._alike(effect) if effect.name() in self.shared else (place,)
            if alike[0] != place:
                continue
            for parameter in effect.free_parameters:
                own = float(getattr(effect, parameter.name))
                found.append(FreeParameter(alike, parameter, parameter.neutral if parameter.spread else own))
        return tuple(found)

    def _alike(self, effect: Effect) -> tuple[int, ...]:
        return tuple(place for place, other in enumerate(self.effects) if other.name() == effect.name())

    @property
    def size(self) -> int:
        """How many numbers are fitted."""
        return len(self.of_effects) + len(self.base)

    @cached_property
    def labels(self) -> list[Label]:
        """What each number stands for: effect, joint and parameter; or a parameter of the model."""
        found: list[Label] = []
        for free in self.of_effects:
            effect = self.effects[free.places[0]]
            joint = "*" if effect.name() in self.shared else effect.joint
            found.append((effect.name(), joint, free.parameter.name))
        return [*found, *((parameter.name,) for parameter in self.base)]

    def effects_at(self, theta: np.ndarray) -> tuple[Effect, ...]:
        """Return the effects for fitted numbers, shape (size,)."""
        values: list[dict[str, float]] = [{} for _ in self.effects]
        for free, number in zip(self.of_effects, theta, strict=False):
            for place in free.places:
                values[place][free.parameter.name] = free.value(float(number))
        return tuple(
            make_effect(effect.name(), effect.joint, found) for effect, found in zip(self.effects, values, strict=True)
        )

    def factors_at(self, theta: np.ndarray) -> dict[str, float]:
        """Return the factors of the model's parameters for fitted numbers, by name."""
        logs = theta[len(self.of_effects) :]
        return {parameter.name: math.exp(float(log)) for parameter, log in zip(self.base, logs, strict=True)}

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the lowest and highest numbers, shape (size,)."""
        pairs = [free.bounds() for free in self.of_effects] + [parameter.bounds for parameter in self.base]
        low, high = np.array(pairs).reshape(-1, 2).T
        return low, high

    def prior(self, theta: np.ndarray) -> np.ndarray:
        """Return each number's weight in the prior, one over its standard deviation, shape (size,)."""
        logs = theta[len(self.of_effects) :]
        base = [1 / parameter.deviation(float(log)) for parameter, log in zip(self.base, logs, strict=True)]
        return np.array([free.weight for free in self.of_effects] + base)

    def start(self, factors: dict[str, float] | None = None) -> np.ndarray:
        """Return the numbers of the first guess, with factors of the model where given, shape (size,)."""
        guesses = [(float(getattr(self.effects[f.places[0]], f.parameter.name)), f) for f in self.of_effects]
        first = [(value - f.start) / SIGNED_SCALE if f.parameter.spread else 0.0 for value, f in guesses]
        logs = [math.log((factors or {}).get(parameter.name, 1.0)) for parameter in self.base]
        return np.array(first + logs)

    def parameters_of(self, column: int) -> tuple[Effect, ...]:
        """Return the effects to which a number belongs; none for one of the model's."""
        if column >= len(self.of_effects):
            return ()
        return tuple(self.effects[place] for place in self.of_effects[column].places)


def free_base(
    base: Sequence[NominalParameter], effects: Sequence[Effect], freed: frozenset[str] = frozenset()
) -> tuple[NominalParameter, ...]:
    """Return the model's parameters that stay free beside effects: not those that an effect replaces.

    Args:
        base: All of them.
        effects: What is beside them.
        freed: Names of those that may be anything, not just a few percent off.
    """
    taken = {f"{effect.joint}.{effect.replaces}" for effect in effects if effect.replaces}
    known = [p for p in base if p.name not in taken and (p.name in freed or p.kind not in FREED_ONLY)]
    return tuple(p.freely() if p.name in freed else p for p in known)
