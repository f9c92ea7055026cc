"""Hypothesis: effects, freed base parameters and shared values, with their fit and score."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from nas_data.effects.base import Effect
from nas_data.gap.nominal_parameters import NominalParameter
from nas_data.gap.search.constants import BEYOND_PRIOR, EXCITED_RATIO, PARAMETER_PRICE, PRICE
from nas_data.gap.search.fit import Fit
from nas_data.gap.search.objective import FitTask
from nas_data.gap.search.parameters import FreeParameters, Label, select_free_base
from nas_data.gap.search.score import Score

Key = tuple[str, str | None]


def effect_key(effect: Effect) -> Key:
    """Return an effect's name and joint."""
    return effect.name(), effect.joint


@dataclass(frozen=True)
class Description:
    """Structure of a hypothesis, without fitted values.

    Attributes:
        effects: Effects at initial guesses.
        freed: Names of the model's freed parameters.
        shared: Names of effects whose parameters are equal in all joints.
    """

    effects: tuple[Effect, ...] = ()
    freed: frozenset[str] = frozenset()
    shared: frozenset[str] = frozenset()

    def add_effects(self, *effects: Effect) -> "Description":
        """Return the description with more effects; the parameters that they replace are no longer freed."""
        taken = {f"{effect.joint}.{effect.replaces}" for effect in effects if effect.replaces}
        return replace(self, effects=(*self.effects, *effects), freed=self.freed - taken)

    def with_effects(self, effects: Sequence[Effect]) -> "Description":
        """Return the description with other effects."""
        return replace(self, effects=tuple(effects))

    def merge(self, other: "Description") -> "Description":
        """Return the union of two descriptions; of equal effects, those of this one."""
        known = {effect_key(effect) for effect in self.effects}
        more = [effect for effect in other.effects if effect_key(effect) not in known]
        taken = {f"{effect.joint}.{effect.replaces}" for effect in (*self.effects, *more) if effect.replaces}
        return replace(self, effects=(*self.effects, *more), freed=(self.freed | other.freed) - taken)

    def without_effect(self, number: int) -> "Description":
        """Return the description without the effect of an index."""
        rest = tuple(effect for place, effect in enumerate(self.effects) if place != number)
        left = {effect.name() for effect in rest}
        return replace(self, effects=rest, shared=self.shared & left)

    def parameters(self, base: Sequence[NominalParameter]) -> FreeParameters:
        """Return the free parameters of a fit."""
        return FreeParameters(self.effects, select_free_base(base, self.effects, self.freed), self.shared)

    @property
    def price(self) -> float:
        """Price of all parts [nats]; a shared value counts once."""
        counted = {
            effect.name() if effect.name() in self.shared else effect_key(effect): effect for effect in self.effects
        }
        return PRICE * len(self.freed) + sum(compute_effect_price(effect) for effect in counted.values())


def compute_effect_price(effect: Effect) -> float:
    """Return the price of one effect [nats]."""
    further = PARAMETER_PRICE * max(0, len(effect.free_parameters) - 1)
    return PRICE + further + (0.0 if effect.in_model else PARAMETER_PRICE)


@dataclass(frozen=True)
class Hypothesis:
    """A fitted description with its predictions of held-out episodes.

    Attributes:
        description: Structure; its effects have fitted parameters.
        fit: Fit to some training episodes.
        heldout: Mean squared errors on held-out episodes [rad²; m²], shape (E, n).
        heldout_misfit: Misfit of the held-out episodes [nats], same objective.
        unspecific_gain: Gain that a recording without the change has, too [nats]; see `Contrast`.
    """

    description: Description
    fit: Fit
    heldout: np.ndarray
    heldout_misfit: float
    unspecific_gain: float = 0.0

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The fitted effects."""
        return self.description.effects

    @property
    def score(self) -> Score:
        """Loss on fitted episodes plus held-out misfit, price and unspecific gain; lower is better."""
        return self.fit.loss + (self.heldout_misfit + self.description.price + self.unspecific_gain)

    @property
    def is_finite(self) -> bool:
        """Whether no held-out rollout diverges."""
        return bool(np.isfinite(self.heldout).all())

    def describe(self, most: int | None = None) -> str:
        """Return effects and factors on one line, at most some: effects that were added last come first."""
        parts = [
            f"{e.name()}({e.joint or 'arm'}: {', '.join(f'{getattr(e, p.name):.4g}' for p in e.free_parameters)})"
            for e in self.effects
        ]
        parts = parts[::-1] + [f"{name} × {self.fit.factors[name]:.3g}" for name in sorted(self.description.freed)]
        more = [f"{len(parts) - most} more"] if most is not None and len(parts) > most else []
        return ", ".join(parts[:most] + more) or "nothing added"


def excited_joints(task: FitTask) -> set[str]:
    """Return the joints that were commanded to move and moved; the data say nothing about the others."""
    evidence = task.evidence
    commanded = ~evidence.find_constant_commands()
    moved = np.ptp(evidence.measured, axis=1).max(0) > EXCITED_RATIO * task.floor
    return {joint for joint, excited in zip(evidence.joints, commanded & moved, strict=True) if excited}


def find_joints_beyond_prior(h: Hypothesis) -> set[str]:
    """Return the joints with a base parameter beyond its prior."""
    return {base.joint for base in h.fit.parameters.base if is_beyond_prior(h, base)}


def is_beyond_prior(h: Hypothesis, base: NominalParameter) -> bool:
    """Whether a bounded base parameter is too far from the model's for its prior."""
    log = float(np.log(h.fit.factors[base.name]))
    return not base.is_free and abs(log) > BEYOND_PRIOR * base.deviation(log)


def can_free_base_parameter(h: Hypothesis, effect: Effect) -> bool:
    """Whether a base parameter beyond its prior may compensate for a missing effect."""
    kind = effect.replaces or effect.distorts
    near = [base for base in h.fit.parameters.base if base.kind == kind and effect.local_joint in (None, base.joint)]
    return any(is_beyond_prior(h, base) for base in near)


def reuse_jacobian(near: Fit | None, parameters: FreeParameters, fresh: int = 0) -> dict[int, np.ndarray]:
    """Return another fit's columns for the parameters that a hypothesis shares with it, by index.

    The column of a value shared by several joints is the sum of their columns.

    Args:
        near: Other fit.
        parameters: Free parameters of the hypothesis.
        fresh: Number of last effects whose columns are not reused.
    """
    if near is None:
        return {}
    known: dict[Label, np.ndarray] = dict(zip(near.parameters.labels, near.jacobian, strict=True))
    last = len(parameters.effects) - fresh
    found = {}
    for index, label in enumerate(parameters.labels):
        places = (
            parameters.effect_parameters[index].effect_indices if index < len(parameters.effect_parameters) else (-1,)
        )
        if places[0] >= last:
            continue
        if label in known:
            found[index] = known[label]
        elif "*" in label:
            single = [(label[0], parameters.effects[place].joint, label[2]) for place in places]
            if all(each in known for each in single):
                found[index] = np.sum([known[each] for each in single], axis=0)
    return found
