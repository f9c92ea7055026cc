"""Interface of effects: an effect is a named physical cause of a gap, with bounded parameters, that edits a model."""

import json
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from numbers import Real
from pathlib import Path
from typing import ClassVar, Self

import mujoco

from nas_data import registry
from nas_data.effects.edits.explicit_values import make_values_explicit
from nas_data.effects.edits.hook import StepHook
from nas_data.errors import JointMismatch, NasError, OptionError
from nas_data.joint_units import convert_hinge_unit
from nas_data.mjcf.actuator_lookup import find_driven_joint, is_group_off

DETAIL_START = 1e-3  # initial value of an optional parameter over its spread, just off neutral, so that it is fitted


@dataclass(frozen=True)
class Parameter:
    """A parameter of an effect.

    Attributes:
        name: Field of the effect.
        unit: Unit at a hinge; empty for a ratio. `joint_units.convert_hinge_unit` gives the unit at a slide.
        low: Lower bound.
        high: Upper bound.
        neutral: Value at which the effect changes nothing.
        spread: Standard deviation of the prior around the neutral value, in the same unit; it makes the parameter
            optional. Infinite for an optional parameter with a uniform prior, 0 for others.
        scaled_by: For a parameter of either sign that is no length or angle: the parameter of the effect whose value is
            its scale.
    """

    name: str
    unit: str
    low: float
    high: float
    neutral: float
    spread: float = 0.0
    scaled_by: str = ""

    @property
    def units(self) -> str:
        """The unit at a hinge, and the unit at a slide if it differs."""
        other = convert_hinge_unit(self.unit, slide=True)
        return self.unit if other == self.unit else f"{self.unit} ({other} at a slide)"


@dataclass(frozen=True)
class Scales:
    """Orders of magnitude at a joint, from which initial guesses of an effect's parameters are made.

    Attributes:
        stiffness: Position gain of the servo [N·m/rad]; for a torque motor, its large torque over one radian.
        damping: Damping of joint and servo [N·m·s/rad].
        inertia: Inertia about the joint in the reference posture, including the rotor [kg·m²].
        mass: Mass that the last joint moves [kg].
        torque: Large torque of the actuator [N·m].
        speed: Large speed of the joint [rad/s].
        radian: Equivalent of one radian: 1 for a hinge, a share of the range for a slide [m].
        velocity_servo: Whether the actuator is a servo with velocity feedback only.
        position_servo: Whether the actuator is a servo that is commanded a position.
        depth: Depth of the arm's lowest measured point below the first joint's axis [m]; 0 without collision shapes.
        commanded_depth: The same in the commanded poses; 0 where positions are not commanded.
    """

    stiffness: float
    damping: float
    inertia: float
    mass: float
    torque: float
    speed: float
    radian: float = 1.0
    velocity_servo: bool = False
    position_servo: bool = False
    depth: float = 0.0
    commanded_depth: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Effect:
    """Base of the effects; the file `effects/a_b.py` holds the effect `a_b` as class `AB`.

    Attributes:
        joint: Joint on which it acts; None for the whole arm.
        whole_arm: Whether it may act on the whole arm.
        per_joint: Whether it may act on one joint.
        per_link: Whether it may act on one link, that of `joint`, and through it on the joints before it.
        in_model: Whether the edited model alone expresses it; otherwise its hook is needed, too.
        replaces: Nominal parameter of its joint that it sets, so that a fit frees only one of both; empty if none.
        distorts: Kind of nominal parameter that a fit without the effect distorts, if `replaces` is empty.
        stepwise: Names of its parameters [s] that act in whole physics steps.
        edit_order: Edits run in ascending order. An edit that depends on masses, gains or joints follows the edits
            that change them.
        equation: Defining equation.
        source: Source of the equation or model.
        signature: Typical sign of the effect in a recording.
        confused_with: Names of effects with similar signatures.
    """

    joint: str | None = None

    parameters: ClassVar[tuple[Parameter, ...]] = ()
    whole_arm: ClassVar[bool] = False
    per_joint: ClassVar[bool] = True
    per_link: ClassVar[bool] = False
    in_model: ClassVar[bool] = True
    edit_order: ClassVar[int] = 0
    replaces: ClassVar[str] = ""
    distorts: ClassVar[str] = ""
    stepwise: ClassVar[tuple[str, ...]] = ()
    equation: ClassVar[str] = ""
    source: ClassVar[str] = ""
    signature: ClassVar[str] = ""
    confused_with: ClassVar[tuple[str, ...]] = ()

    def __post_init__(self) -> None:
        if self.joint is not None and not (self.per_joint or self.per_link):
            raise OptionError(f"{self.name()} belongs to the whole arm; leave out joint={self.joint}.")
        for parameter in self.parameters:
            value = getattr(self, parameter.name)
            if not min(parameter.low, parameter.neutral) <= value <= max(parameter.high, parameter.neutral):
                raise OptionError(
                    f"{self.name()}: {parameter.name} is {value}; "
                    f"it must lie in {parameter.low} … {parameter.high} {parameter.units}".rstrip()
                    + "."
                )

    @classmethod
    def name(cls) -> str:
        """Return the effect's name: the class name in snake case, which is the name of its file."""
        return registry.to_snake_case(cls.__name__)

    @classmethod
    def neutral(cls, joint: str | None = None) -> Self:
        """Return the effect with neutral parameters."""
        return cls(joint=joint, **{parameter.name: parameter.neutral for parameter in cls.parameters})

    @property
    def is_neutral(self) -> bool:
        """Whether every parameter has its neutral value."""
        return all(getattr(self, parameter.name) == parameter.neutral for parameter in self.parameters)

    @property
    def local_joint(self) -> str | None:
        """Joint in which alone it acts; None if it acts in several."""
        return self.joint if self.per_joint else None

    @property
    def constant_error(self) -> float | None:
        """Position error [rad; slides m] that it makes the same in every posture; None for an effect that does not."""
        return None

    @property
    def free_parameters(self) -> tuple[Parameter, ...]:
        """The parameters that a fit frees: optional ones only if at least one of them is not neutral."""
        details = any(getattr(self, p.name) != p.neutral for p in self.parameters if p.spread)
        return tuple(p for p in self.parameters if details or not p.spread)

    def with_optional_parameters(self, scales: Scales | None) -> "Effect":
        """Return the effect with initial guesses of its optional parameters, so that a fit frees them.

        Args:
            scales: Scales of the effect's joint; None for the whole arm.
        """
        if self.free_parameters == self.parameters:
            return self
        own = {p.name: getattr(self, p.name) for p in self.parameters}
        guess = self.optional_guess(scales)
        return make_effect(self.name(), self.joint, {**own, **guess}) if guess else self

    def without_optional_parameters(self) -> Self:
        """Return the effect with its optional parameters at their neutral values, so that a fit leaves them there."""
        values = {p.name: p.neutral if p.spread else getattr(self, p.name) for p in self.parameters}
        return type(self)(joint=self.joint, **values)

    @classmethod
    def optional_guess(cls, scales: Scales | None) -> Mapping[str, float]:
        """Return initial guesses of the optional parameters: just off neutral if they have a prior around it."""
        return {p.name: DETAIL_START * p.spread for p in cls.parameters if p.spread}

    def has_preferred_equivalent(self, scales: Scales) -> bool:
        """Whether another effect is named instead, because it is equivalent with these parameters at such a joint."""
        return False

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Add the effect to a model; only called with parameters that are not neutral."""
        raise NotImplementedError(f"{type(self).__name__} has no edit()")

    @classmethod
    def hook(cls, effects: Sequence[Self], model: mujoco.MjModel) -> StepHook | None:
        """Return the hook that runs before each physics step for all effects of this class; None if not needed."""
        return None

    @classmethod
    def guesses(cls, scales: Scales) -> tuple[Mapping[str, float], ...]:
        """Return initial guesses of the parameters in ascending size; empty if the effect is not searched for."""
        return ()

    @classmethod
    def vanishing_value(cls, scales: Scales) -> float:
        """Return the value of the first parameter at which the effect vanishes at a joint of these scales."""
        return cls.parameters[0].neutral

    def equivalents(self, scales: Scales) -> tuple["Effect", ...]:
        """Return effects, at initial guesses, that may be equivalent at such a joint and are not searched for there."""
        return ()

    def nearest_in_model(self, scales: Scales) -> "Effect | None":
        """Return the most similar effect that a model alone expresses, possibly this one; None if there is none."""
        return self if self.in_model else None

    def written_form(self, scales: Scales) -> "Effect | None":
        """Return an equivalent effect that a model file expresses, at a joint of these scales; None if none does."""
        return self if self.in_model else None

    def expressible_part(self) -> "Effect":
        """Return the effect without optional parameters that no model file expresses."""
        return self

    def to_json(self, slides: Collection[str] = ()) -> dict[str, object]:
        """Return the effect as an entry of `effects.json`, without optional parameters that are neutral.

        Args:
            slides: Names of the slides, whose parameters have other units.
        """
        slide = self.joint in slides
        values = {
            p.name: {"value": getattr(self, p.name), "unit": convert_hinge_unit(p.unit, slide)}
            for p in self.free_parameters
        }
        return {"effect": self.name(), "joint": self.joint, "parameters": values}


def find_effect(name: str) -> type[Effect]:
    """Return the class of an effect by its name.

    Raises:
        UnknownName: there is no such effect; the message lists the known ones.
    """
    return registry.find_plugin("effects", name, "effect", Effect)


def make_effect(name: str, joint: str | None, values: Mapping[str, object]) -> Effect:
    """Build an effect from its name and parameter values.

    Raises:
        UnknownName: there is no such effect.
        OptionError: a parameter is unknown, missing or out of its range.
    """
    kind = find_effect(name)
    known = {field.name for field in fields(kind)} - {"joint"}
    given = sorted(values)
    values = {p.name: p.neutral for p in kind.parameters if p.spread} | dict(values)
    wrong = sorted(set(values) ^ known)
    if wrong:
        optional = {p.name for p in kind.parameters if p.spread}
        takes = ", ".join([*sorted(known - optional), *(f"{other} (optional)" for other in sorted(optional))])
        raise OptionError(f"{name} takes the parameters {takes}; given: {', '.join(given) or 'none'}.")
    if joint is None and not kind.whole_arm:
        raise OptionError(f"{name} belongs to a joint; give joint=NAME.")
    # text and truth values are not accepted as numbers
    numbers = {k: float(v) for k, v in values.items() if isinstance(v, Real) and not isinstance(v, bool)}
    other = next((key for key in values if key not in numbers), None)
    if other is not None:
        raise OptionError(f"{name}: {other} is {values[other]!r}; a number is needed.")
    return kind(joint=joint, **numbers)


def from_json(entry: Mapping[str, object]) -> Effect:
    """Read one entry of `effects.json`; parameters are numbers or objects with a `value`.

    Raises:
        UnknownName: there is no such effect.
        OptionError: the entry is malformed.
    """
    if not isinstance(entry, Mapping):
        raise OptionError(f"{entry!r} is not an effect; an object with 'effect', 'joint' and 'parameters' is needed.")
    parameters = entry.get("parameters", {})
    if not isinstance(parameters, Mapping):
        raise OptionError(f"The parameters of {entry.get('effect')} must be an object of numbers.")
    values = {key: item.get("value") if isinstance(item, Mapping) else item for key, item in parameters.items()}
    joint = entry.get("joint")
    return make_effect(str(entry.get("effect")), None if joint is None else str(joint), values)


def parse(text: str) -> Effect:
    """Parse an effect from the command line: `backlash:joint=m3,half_width=0.02`.

    Raises:
        UnknownName: there is no such effect.
        OptionError: the text is malformed, or a parameter is out of its range.
    """
    name, _, rest = text.partition(":")
    pairs = [part.partition("=") for part in rest.split(",") if part]
    if any(not equals for _, equals, _ in pairs):
        raise OptionError(f"'{text}' is not an effect; write NAME:joint=JOINT,PARAMETER=NUMBER.")
    values = {key.strip(): value.strip() for key, _, value in pairs}
    joint = values.pop("joint", None)
    try:
        return make_effect(name, joint, {key: float(value) for key, value in values.items()})
    except ValueError as error:
        if isinstance(error, OptionError):
            raise
        raise OptionError(f"'{text}' has a parameter that is not a number.") from None


def read_effects(path: Path) -> tuple[Effect, ...]:
    """Read an `effects.json`: a list of effects, or an object with such a list under `effects`.

    Raises:
        OptionError: the file is missing or malformed.
    """
    if path.is_dir() or not path.exists():
        raise OptionError(f"There is no file {path}; give the effects.json of a gap report.")
    try:
        content = json.loads(path.read_text(encoding="utf-8-sig"))
        entries = content["effects"] if isinstance(content, dict) else content
        if not isinstance(entries, list):
            raise TypeError("it is not a list")
        return tuple(from_json(entry) for entry in entries)
    except NasError as error:
        raise OptionError(f"{path}: {error}") from None
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise OptionError(f"{path} is not a list of effects ({error}); see the effects.json of a gap report.") from None


def add_effects(spec: mujoco.MjSpec, effects: Iterable[Effect]) -> None:
    """Add effects to a model; neutral effects change nothing.

    Raises:
        JointMismatch: an effect names a joint that the model lacks.
    """
    chosen = sorted(effects, key=lambda effect: effect.edit_order)
    if not all(effect.is_neutral for effect in chosen):
        make_values_explicit(spec)
    for effect in chosen:
        if effect.joint is not None and spec.joint(effect.joint) is None:
            names = ", ".join(joint.name for joint in spec.joints if joint.name)
            raise JointMismatch(f"{effect.name()} names the joint '{effect.joint}'; the model has: {names}.")
        if not effect.is_neutral:
            effect.edit(spec)


def find_joint_actuator(spec: mujoco.MjSpec, joint: str) -> mujoco.MjsActuator:
    """Return the actuator that drives a joint; of several, the first with position feedback that is not switched off.

    Raises:
        JointMismatch: no actuator drives the joint.
    """
    driving = [actuator for actuator in spec.actuators if find_driven_joint(spec, actuator) == joint]
    if not driving:
        raise JointMismatch(f"No actuator of the model drives the joint '{joint}'.")
    off = spec.option.disableactuator
    return min(driving, key=lambda each: (is_group_off(each.group, off), each.biasprm[1] == 0))
