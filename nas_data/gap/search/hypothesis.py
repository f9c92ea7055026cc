"""A hypothesis: which effects, which of the model's parameters are free, which values joints share; and its score."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from nas_data.effects.base import Effect
from nas_data.gap.nominal_parameters import NominalParameter
from nas_data.gap.search.fit import Fit
from nas_data.gap.search.objective import FitTask, Score
from nas_data.gap.search.parameters import FreeParameters, Label, free_base

PRICE = 12.0  # nats that an effect, or a freed parameter of the model, must bring
DETAIL_PRICE = 3.0  # the same for every further parameter of an effect
HOOK_PRICE = 2.0  # the same besides for an effect that a model file cannot express by itself
BEYOND_PRIOR = 2.5  # standard deviations from which a parameter of the model is hardly to be believed
EXCITED = 10.0  # noise floors between a joint's extremes in an episode from which it counts as having moved

Key = tuple[str, str | None]


def key(effect: Effect) -> Key:
    """Return an effect's name and joint."""
    return effect.name(), effect.joint


@dataclass(frozen=True)
class Description:
    """What is assumed of a robot, without the fitted numbers.

    Attributes:
        effects: Effects, at guesses of their parameters.
        freed: Names of the model's parameters that may be anything.
        shared: Names of effects whose parameters are alike in all joints.
    """

    effects: tuple[Effect, ...] = ()
    freed: frozenset[str] = frozenset()
    shared: frozenset[str] = frozenset()

    def adding(self, *effects: Effect) -> "Description":
        """Return the description with more effects; what they replace is freed no more."""
        taken = {f"{effect.joint}.{effect.replaces}" for effect in effects if effect.replaces}
        return replace(self, effects=(*self.effects, *effects), freed=self.freed - taken)

    def with_effects(self, effects: Sequence[Effect]) -> "Description":
        """Return the description with other effects."""
        return replace(self, effects=tuple(effects))

    def together_with(self, other: "Description") -> "Description":
        """Return the description with what another assumes besides."""
        known = {key(effect) for effect in self.effects}
        more = [effect for effect in other.effects if key(effect) not in known]
        taken = {f"{effect.joint}.{effect.replaces}" for effect in (*self.effects, *more) if effect.replaces}
        return replace(self, effects=(*self.effects, *more), freed=(self.freed | other.freed) - taken)

    def without(self, number: int) -> "Description":
        """Return the description without one effect."""
        rest = tuple(effect for place, effect in enumerate(self.effects) if place != number)
        left = {effect.name() for effect in rest}
        return replace(self, effects=rest, shared=self.shared & left)

    def parameters(self, base: Sequence[NominalParameter]) -> FreeParameters:
        """Return what a fit of the description moves."""
        return FreeParameters(self.effects, free_base(base, self.effects, self.freed), self.shared)

    @property
    def cost(self) -> float:
        """What the description must bring to be believed [nats]; a shared value costs once."""
        counted = {effect.name() if effect.name() in self.shared else key(effect): effect for effect in self.effects}
        return PRICE * len(self.freed) + sum(effect_cost(effect) for effect in counted.values())


def effect_cost(effect: Effect) -> float:
    """Return what one effect must bring [nats]."""
    further = DETAIL_PRICE * max(0, len(effect.free_parameters) - 1)
    return PRICE + further + (0.0 if effect.in_model else HOOK_PRICE)


@dataclass(frozen=True)
class Hypothesis:
    """A fitted description, judged also on held-out episodes.

    Attributes:
        description: What is assumed; its effects have fitted parameters.
        fit: Fit on some training episodes.
        heldout: Mean squares on held-out episodes [rad²], shape (E, n).
        heldout_misfit: The misfit there, of the same objective.
    """

    description: Description
    fit: Fit
    heldout: np.ndarray
    heldout_misfit: float

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The fitted effects."""
        return self.description.effects

    @property
    def score(self) -> Score:
        """Loss on the fitted episodes, misfit on held-out ones, and the description's cost; less is better."""
        return self.fit.loss + (self.heldout_misfit + self.description.cost)

    @property
    def is_sound(self) -> bool:
        """Whether the model runs on every held-out episode without diverging."""
        return bool(np.isfinite(self.heldout).all())

    def text(self) -> str:
        """Say it in a line."""
        parts = [
            f"{e.name()}({e.joint or 'arm'}: {', '.join(f'{getattr(e, p.name):.4g}' for p in e.free_parameters)})"
            for e in self.effects
        ]
        parts += [f"{name} × {self.fit.factors[name]:.3g}" for name in sorted(self.description.freed)]
        return ", ".join(parts) or "base only"


def excited_joints(task: FitTask) -> set[str]:
    """Return the joints that were commanded to move and moved: a joint that stood still tells no cause."""
    evidence = task.evidence
    commanded = np.ptp(evidence.commands, axis=1).max(0) > 0
    moved = np.ptp(evidence.measured, axis=1).max(0) > EXCITED * task.floor
    return {joint for joint, told in zip(evidence.joints, commanded & moved, strict=True) if told}


def joints_beyond_prior(h: Hypothesis) -> set[str]:
    """Return the joints of which the model's parameters had to go beyond what a real arm's do."""
    return {base.joint for base in h.fit.parameters.base if is_beyond_prior(h, base)}


def is_beyond_prior(h: Hypothesis, base: NominalParameter) -> bool:
    """Whether a parameter of the model had to go beyond what a real arm's does."""
    log = float(np.log(h.fit.factors[base.name]))
    return not base.is_free and abs(log) > BEYOND_PRIOR * base.deviation(log)


def frees_base_parameter(h: Hypothesis, effect: Effect) -> bool:
    """Whether a parameter of the model that went beyond what a real arm's does may stand for an effect."""
    kind = effect.replaces or effect.distorts
    near = [base for base in h.fit.parameters.base if base.kind == kind and effect.joint in (None, base.joint)]
    return any(is_beyond_prior(h, base) for base in near)


def reuse_jacobian(near: Fit | None, parameters: FreeParameters, fresh: int = 0) -> dict[int, np.ndarray]:
    """Return another fit's columns for the numbers that a hypothesis has in common with it, by the number's index.

    A value that joints share moves the positions as those of all joints together do.

    Args:
        near: The other fit.
        parameters: The hypothesis.
        fresh: How many of its last effects are to be measured anyway.
    """
    if near is None:
        return {}
    known: dict[Label, np.ndarray] = dict(zip(near.parameters.labels, near.jacobian, strict=True))
    last = len(parameters.effects) - fresh
    found = {}
    for index, label in enumerate(parameters.labels):
        places = parameters.of_effects[index].places if index < len(parameters.of_effects) else (-1,)
        if places[0] >= last:
            continue
        if label in known:
            found[index] = known[label]
        elif "*" in label:
            single = [(label[0], parameters.effects[place].joint, label[2]) for place in places]
            if all(each in known for each in single):
                found[index] = np.sum([known[each] for each in single], axis=0)
    return found
