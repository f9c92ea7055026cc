"""Effects in a gap report: names, fitted parameters, rivals, and what a name rests on."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from nas_data.joint_units import HINGE

NAME = {"key": "effect"}
OPTIONAL = {"optional": True}
CONTRADICTED = 0.5  # position dependence from which a constant effect is doubted in words


@dataclass(frozen=True, kw_only=True)
class FittedParameter:
    """A parameter of an effect.

    Attributes:
        value: Value in `unit`.
        unit: SI unit.
        interval95: 95 % confidence interval if the name is right; None if unknown.
        episode_range: Smallest and largest value of single episodes; None if one value fits them all.
    """

    value: float
    unit: str = ""
    interval95: tuple[float, float] | None = field(default=None, metadata=OPTIONAL)
    episode_range: tuple[float, float] | None = field(default=None, metadata=OPTIONAL)


@dataclass(frozen=True, kw_only=True)
class EffectName:
    """An effect by name and joint; joint is None for the whole arm."""

    name: str = field(metadata=NAME)
    joint: str | None = None

    def __str__(self) -> str:
        """Return the name with its joint."""
        return f"{self.name} in {self.joint}" if self.joint else self.name


@dataclass(frozen=True, kw_only=True)
class Alternative(EffectName):
    """An effect that could replace a named one.

    Attributes:
        parameters: Fitted values by name [SI].
        heldout_error_after: Held-out error with it, in the unit of the named effect's evidence.
    """

    parameters: Mapping[str, float] | None = field(default=None, metadata=OPTIONAL)
    heldout_error_after: float


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """What a name rests on.

    Attributes:
        heldout_error_before: Held-out open-loop RMSE without the effect, everything else fitted again.
        heldout_error_after: The same with it.
        unit: Unit of both errors: rad, or m for a slide.
        closest_rival: Closeness of the nearest rival: 1 if it predicts as well in every joint, 0 if much worse.
        chosen: Share of random draws of the episodes in which the name is worth its price.
        position_dependence: For an effect that is the same in every posture, how far the remaining error, which depends
            on the position, contradicts that: 0 not at all, 1 fully. None for other effects.
    """

    heldout_error_before: float
    heldout_error_after: float
    unit: str = HINGE.si
    closest_rival: float | None = field(default=None, metadata=OPTIONAL)
    chosen: float | None = field(default=None, metadata=OPTIONAL)
    position_dependence: float | None = field(default=None, metadata=OPTIONAL)

    @property
    def contradicts_constant(self) -> bool:
        """Whether the remaining error contradicts that the effect is the same in every posture."""
        return self.position_dependence is not None and self.position_dependence >= CONTRADICTED


@dataclass(frozen=True, kw_only=True, repr=False)
class NamedEffect(EffectName):
    """An effect that the model lacks.

    Attributes:
        parameters: Fitted parameters by name.
        confidence: Probability that name and joint are right.
        evidence: Error without and with it, everything else fitted again.
        alternatives: Rivals in its place, best first.
        equals: Rivals that these data cannot distinguish from it.
        in_model_xml: Whether `model.xml` expresses it; `effects.json` always does.
    """

    parameters: Mapping[str, FittedParameter]
    confidence: float
    evidence: Evidence
    alternatives: tuple[Alternative, ...] = ()
    equals: tuple[EffectName, ...] = ()
    in_model_xml: bool = True

    def __repr__(self) -> str:
        """Return name, joint, parameters and confidence in a line."""
        values = ", ".join(f"{name} {one.value:.4g} {one.unit}".strip() for name, one in self.parameters.items())
        return f"NamedEffect({self}: {values}; confidence {self.confidence:.2f})"


@dataclass(frozen=True, kw_only=True)
class FittedEffect(EffectName):
    """An effect with its fitted parameters by name."""

    parameters: Mapping[str, FittedParameter] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Placebo:
    """Runner-up in place of the name with the highest confidence.

    Attributes:
        effects: All effects of that model.
        after: Held-out error, in the unit of the gap.
        text: Replacement in words.
    """

    effects: tuple[FittedEffect, ...]
    after: float
    text: str
