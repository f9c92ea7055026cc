"""Free parameters of a fit, of effects and of the model, as one dimensionless vector θ."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from nas_data.effects.base import Effect, Parameter, make_effect
from nas_data.gap.nominal_parameters import NominalParameter

STEP = 0.02  # finite difference of θ, above the roughness that contacts and friction cause
SIGNED_SCALE = 0.05  # [rad; m] per unit of θ of a position with either sign
FREED_ONLY = ("limit",)  # kinds of base parameters that are fixed unless freed, because models state ratings
MAX_LOG_RANGE = math.log(1000.0)  # largest change of a positive parameter from its initial guess

Label = tuple[str | None, ...]


@dataclass(frozen=True)
class FreeParameter:
    """One parameter of an effect, or of the same effect in several joints, as one entry of θ.

    Attributes:
        effect_indices: Indices of the effects that have it.
        parameter: Parameter of these effects.
        v0: Value at θ = 0: the initial guess, or the neutral value if the parameter has a prior.
        scale: Change of the value per unit of θ, if the parameter has either sign.
    """

    effect_indices: tuple[int, ...]
    parameter: Parameter
    v0: float
    scale: float = SIGNED_SCALE

    @property
    def signed(self) -> bool:
        """Whether the parameter has either sign; others are fitted as logarithms."""
        return self.parameter.low < 0

    @property
    def prior_weight(self) -> float:
        """Inverse standard deviation of the prior; 0 for a uniform prior."""
        return self.scale / self.parameter.spread if self.parameter.spread else 0.0

    def value(self, number: float) -> float:
        """Return the parameter's value v₀ exp(θ), or v₀ + scale · θ if it is signed, within its bounds."""
        return float(np.clip(self.move(self.v0, number), self.parameter.low, self.parameter.high))

    def move(self, value: float, change: float) -> float:
        """Return a value after a change of θ, without bounds."""
        factor = math.exp(min(max(change, -MAX_LOG_RANGE), MAX_LOG_RANGE))
        return value + self.scale * change if self.signed else value * factor

    def bounds(self) -> tuple[float, float]:
        """Return the bounds of θ."""
        low, high = self.parameter.low, self.parameter.high
        if self.signed:
            return (low - self.v0) / self.scale, (high - self.v0) / self.scale
        lowest = math.log(low / self.v0) if low > 0 else -MAX_LOG_RANGE
        return max(lowest, -MAX_LOG_RANGE), min(math.log(high / self.v0), MAX_LOG_RANGE)


@dataclass(frozen=True)
class FreeParameters:
    """Free parameters of a fit: those of effects, then those of the model.

    Attributes:
        effects: Effects at initial guesses.
        base: Free base parameters of the model.
        shared: Names of effects whose parameters are equal in all joints.
    """

    effects: tuple[Effect, ...]
    base: tuple[NominalParameter, ...]
    shared: frozenset[str] = frozenset()

    @cached_property
    def effect_parameters(self) -> tuple[FreeParameter, ...]:
        """Free parameters of the effects in order; optional ones only if one of them is not neutral."""
        found = []
        for place, effect in enumerate(self.effects):
            alike = self._find_effect_indices(effect) if effect.name() in self.shared else (place,)
            if alike[0] != place:
                continue
            for parameter in effect.free_parameters:
                own = float(getattr(effect, parameter.name))
                has_prior = 0 < parameter.spread < math.inf
                v0 = parameter.neutral if has_prior else own
                scale = abs(getattr(effect, parameter.scaled_by)) if parameter.scaled_by else SIGNED_SCALE
                found.append(FreeParameter(alike, parameter, v0, scale or SIGNED_SCALE))
        return tuple(found)

    def _find_effect_indices(self, effect: Effect) -> tuple[int, ...]:
        return tuple(place for place, other in enumerate(self.effects) if other.name() == effect.name())

    @property
    def size(self) -> int:
        """Length of θ."""
        return len(self.effect_parameters) + len(self.base)

    @cached_property
    def labels(self) -> list[Label]:
        """Meaning of each entry of θ: (effect, joint, parameter), or (base parameter,)."""
        found: list[Label] = []
        for free in self.effect_parameters:
            effect = self.effects[free.effect_indices[0]]
            joint = "*" if effect.name() in self.shared else effect.joint
            found.append((effect.name(), joint, free.parameter.name))
        return [*found, *((parameter.name,) for parameter in self.base)]

    def effects_at(self, theta: np.ndarray) -> tuple[Effect, ...]:
        """Return the effects at θ, shape (size,)."""
        values: list[dict[str, float]] = [{} for _ in self.effects]
        for free, number in zip(self.effect_parameters, theta, strict=False):
            for place in free.effect_indices:
                values[place][free.parameter.name] = free.value(float(number))
        return tuple(
            make_effect(effect.name(), effect.joint, found) for effect, found in zip(self.effects, values, strict=True)
        )

    def factors_at(self, theta: np.ndarray) -> dict[str, float]:
        """Return the factors of the model's parameters at θ, by name."""
        logs = theta[len(self.effect_parameters) :]
        return {parameter.name: math.exp(float(log)) for parameter, log in zip(self.base, logs, strict=True)}

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Return lower and upper bounds of θ, shape (size,) each."""
        pairs = [free.bounds() for free in self.effect_parameters] + [parameter.bounds for parameter in self.base]
        low, high = np.array(pairs).reshape(-1, 2).T
        return low, high

    def prior_weights(self, theta: np.ndarray) -> np.ndarray:
        """Return the inverse standard deviations 1/σ of the prior at θ, shape (size,)."""
        logs = theta[len(self.effect_parameters) :]
        base = [1 / parameter.deviation(float(log)) for parameter, log in zip(self.base, logs, strict=True)]
        return np.array([free.prior_weight for free in self.effect_parameters] + base)

    def initial_theta(self, factors: dict[str, float] | None = None) -> np.ndarray:
        """Return θ at the initial guesses, with given factors of the model, shape (size,)."""
        guesses = [
            (float(getattr(self.effects[f.effect_indices[0]], f.parameter.name)), f) for f in self.effect_parameters
        ]
        first = [(value - f.v0) / f.scale if f.parameter.spread else 0.0 for value, f in guesses]
        logs = [math.log((factors or {}).get(parameter.name, 1.0)) for parameter in self.base]
        return np.array(first + logs)

    def effects_of(self, column: int) -> tuple[Effect, ...]:
        """Return the effects of a column; empty for a base parameter."""
        if column >= len(self.effect_parameters):
            return ()
        return tuple(self.effects[place] for place in self.effect_parameters[column].effect_indices)

    def find_local_joint(self, column: int) -> str | None:
        """Return the joint in which alone a column's effect or base parameter acts; None if it acts in several."""
        effects = self.effects_of(column)
        if not effects:
            return self.base[column - len(self.effect_parameters)].joint
        return effects[0].local_joint if len(effects) == 1 and effects[0].name() not in self.shared else None


def select_free_base(
    base: Sequence[NominalParameter], effects: Sequence[Effect], freed: frozenset[str] = frozenset()
) -> tuple[NominalParameter, ...]:
    """Return the base parameters that stay free beside effects, without those that an effect replaces.

    Args:
        base: Base parameters of the model.
        effects: Effects of the hypothesis.
        freed: Names of freed parameters.
    """
    taken = {f"{effect.joint}.{effect.replaces}" for effect in effects if effect.replaces}
    known = [p for p in base if p.name not in taken and (p.name in freed or p.kind not in FREED_ONLY)]
    return tuple(p.with_free_prior() if p.name in freed else p for p in known)
