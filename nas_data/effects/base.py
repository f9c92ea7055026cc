"""What an effect is: a named physical cause of a gap, with bounded parameters, that edits a model."""

import json
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from numbers import Real
from pathlib import Path
from typing import ClassVar, Self

import mujoco

from nas_data import registry
from nas_data.effects.edits.damping_ratio import settle_damping
from nas_data.effects.edits.hook import StepHook
from nas_data.errors import JointMismatch, NasError, OptionError
from nas_data.joint_units import unit_at
from nas_data.mjcf.actuator_lookup import driven_joint

HARDLY = 1e-3  # of its spread by which a detail is put beside its neutral zero to be sought


@dataclass(frozen=True)
class Parameter:
    """One number of an effect.

    Attributes:
        name: Field of the effect.
        unit: Its unit at a hinge; empty for a ratio. At a slide it is what `joint_units.unit_at` says.
        low: Smallest sensible value.
        high: Largest sensible value.
        neutral: Value at which the effect changes nothing.
        spread: Standard deviation of what is plausible around the neutral value, in its unit: such a parameter is a
            detail that may be left out and is then neutral. 0 where all values within the bounds are as plausible.
    """

    name: str
    unit: str
    low: float
    high: float
    neutral: float
    spread: float = 0.0

    @property
    def units(self) -> str:
        """The unit at a hinge, and at a slide where that is another."""
        other = unit_at(self.unit, slide=True)
        return self.unit if other == self.unit else f"{self.unit} ({other} at a slide)"


@dataclass(frozen=True)
class Scales:
    """What is big and small at a joint, from which first guesses of an effect's parameters are made.

    Attributes:
        stiffness: Position gain of the servo [N·m/rad]; for a torque motor its large torque over one radian.
        damping: Damping of joint and servo [N·m·s/rad].
        inertia: Inertia about the joint in the reference posture, rotor included [kg·m²].
        mass: Mass that the last joint moves [kg].
        torque: Large torque of the actuator [N·m].
        speed: Large speed of the joint [rad/s].
        radian: What stands for a radian: 1, or the range of a slide over that of a usual hinge [m].
    """

    stiffness: float
    damping: float
    inertia: float
    mass: float
    torque: float
    speed: float
    radian: float = 1.0


@dataclass(frozen=True, kw_only=True)
class Effect:
    """Base of the effects; the file `effects/a_b.py` holds the effect `a_b` as class `AB`.

    Attributes:
        joint: Joint it sits in; None where it belongs to the whole arm.
        whole_arm: Whether it may go without a joint.
        per_joint: Whether it may name a joint.
        in_model: Whether the edited model alone expresses it; otherwise only with its hook.
        replaces: Base parameter of its joint that it sets itself, so that both are not sought at once; or nothing.
        strains: Kind of base parameter that strays where this is missing, if none is replaced.
        stepwise: Its parameters [s] that act in whole physics steps.
        late: Rank of its edit: one that is fitted to what others change (masses, gains, the joints that there are)
            comes after theirs.
    """

    joint: str | None = None

    parameters: ClassVar[tuple[Parameter, ...]] = ()
    whole_arm: ClassVar[bool] = False
    per_joint: ClassVar[bool] = True
    in_model: ClassVar[bool] = True
    late: ClassVar[int] = 0
    replaces: ClassVar[str] = ""
    strains: ClassVar[str] = ""
    stepwise: ClassVar[tuple[str, ...]] = ()
    equation: ClassVar[str] = ""
    source: ClassVar[str] = ""
    signature: ClassVar[str] = ""
    confused_with: ClassVar[tuple[str, ...]] = ()

    def __post_init__(self) -> None:
        if self.joint is not None and not self.per_joint:
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
        """The effect's name: its class's in small letters, which is its file's."""
        return registry.snake_case(cls.__name__)

    @classmethod
    def neutral(cls, joint: str | None = None) -> Self:
        """Return the effect with parameters that change nothing."""
        return cls(joint=joint, **{parameter.name: parameter.neutral for parameter in cls.parameters})

    @property
    def is_neutral(self) -> bool:
        """Whether every parameter has its neutral value."""
        return all(getattr(self, parameter.name) == parameter.neutral for parameter in self.parameters)

    @property
    def sought(self) -> tuple[Parameter, ...]:
        """The parameters that a fit may move: details stay neutral where all of them are."""
        details = any(getattr(self, p.name) != p.neutral for p in self.parameters if p.spread)
        return tuple(p for p in self.parameters if details or not p.spread)

    def detailed(self) -> "Effect":
        """Return the effect with its details hardly neutral, so that they are sought; itself where they are."""
        if self.sought == self.parameters:
            return self
        own = {p.name: getattr(self, p.name) for p in self.parameters}
        return make_effect(
            self.name(), self.joint, own | {p.name: HARDLY * p.spread for p in self.parameters if p.spread}
        )

    @property
    def is_twin(self) -> bool:
        """Whether with these parameters it does what another effect is named for."""
        return False

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Add the effect to a model; never called with neutral parameters."""
        raise NotImplementedError(f"{type(self).__name__} has no edit()")

    @classmethod
    def hook(cls, effects: Sequence[Self], model: mujoco.MjModel) -> StepHook | None:
        """Return what must run before each physics step of a model with effects of this kind; None where nothing."""
        return None

    @classmethod
    def guesses(cls, scales: Scales) -> tuple[Mapping[str, float], ...]:
        """Return first guesses of the parameters, small to large; empty where none is searched for."""
        return ()

    @classmethod
    def idle(cls, scales: Scales) -> float:
        """Return the first parameter's value at which the effect ends to do anything at a joint of these sizes."""
        return cls.parameters[0].neutral

    @classmethod
    def twins(cls, joint: str | None) -> tuple["Effect", ...]:
        """Return effects that may do exactly the same and are never searched for beside it, at first guesses."""
        return ()

    def native(self, scales: Scales) -> "Effect | None":
        """Return the effect nearest to this one that a model alone can express; itself where it can."""
        return self if self.in_model else None

    def written(self, scales: Scales) -> "Effect | None":
        """Return what does the same in a model file, at a joint of these sizes; None where nothing does."""
        return self if self.in_model else None

    def to_json(self, slides: Collection[str] = ()) -> dict[str, object]:
        """Return the effect as `effects.json` holds it, without details that are neutral.

        Args:
            slides: Joints that are slides, which decides the units.
        """
        slide = self.joint in slides
        values = {p.name: {"value": getattr(self, p.name), "unit": unit_at(p.unit, slide)} for p in self.sought}
        return {"effect": self.name(), "joint": self.joint, "parameters": values}


def find_effect(name: str) -> type[Effect]:
    """Return the class of an effect by its name.

    Raises:
        UnknownName: there is no such effect; lists those there are.
    """
    return registry.plugin("effects", name, "effect", Effect)


def make_effect(name: str, joint: str | None, values: Mapping[str, object]) -> Effect:
    """Build an effect from its name and parameter values.

    Raises:
        UnknownName: there is no such effect.
        OptionError: a parameter is unknown, missing or out of its range.
    """
    kind = find_effect(name)
    known = {field.name for field in fields(kind)} - {"joint"}
    values = {p.name: p.neutral for p in kind.parameters if p.spread} | dict(values)
    wrong = sorted(set(values) ^ known)
    if wrong:
        raise OptionError(
            f"{name} takes the parameters {', '.join(sorted(known))}; given: {', '.join(sorted(values)) or 'none'}."
        )
    if joint is None and not kind.whole_arm:
        raise OptionError(f"{name} sits in a joint; say which (joint=NAME).")
    # a text that reads as a number, or a truth value, is none
    numbers = {k: float(v) for k, v in values.items() if isinstance(v, Real) and not isinstance(v, bool)}
    other = next((key for key in values if key not in numbers), None)
    if other is not None:
        raise OptionError(f"{name}: {other} is {values[other]!r}; a number is needed.")
    return kind(joint=joint, **numbers)


def from_json(entry: Mapping[str, object]) -> Effect:
    """Read one entry of `effects.json`; parameters are numbers or objects with a `value`.

    Raises:
        UnknownName: there is no such effect.
        OptionError: the entry has another form.
    """
    if not isinstance(entry, Mapping):
        raise OptionError(f"{entry!r} is no effect; an object with 'effect', 'joint' and 'parameters' is needed.")
    parameters = entry.get("parameters", {})
    if not isinstance(parameters, Mapping):
        raise OptionError(f"The parameters of {entry.get('effect')} must be an object of numbers.")
    values = {key: item.get("value") if isinstance(item, Mapping) else item for key, item in parameters.items()}
    joint = entry.get("joint")
    return make_effect(str(entry.get("effect")), None if joint is None else str(joint), values)


def parse(text: str) -> Effect:
    """Read an effect as a person types it: `backlash:joint=m3,half_width=0.02`.

    Raises:
        OptionError: the text has another form.
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
        raise OptionError(f"'{text}' has a parameter that is no number.") from None


def read_effects(path: Path) -> tuple[Effect, ...]:
    """Read an `effects.json`: a list of effects, or an object with such a list under `effects`.

    Raises:
        OptionError: the file is missing or has another form.
    """
    if path.is_dir() or not path.exists():
        raise OptionError(f"There is no file {path}; give the effects.json of a gap report.")
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        entries = content["effects"] if isinstance(content, dict) else content
        if not isinstance(entries, list):
            raise TypeError("it is no list")
        return tuple(from_json(entry) for entry in entries)
    except NasError as error:
        raise OptionError(f"{path}: {error}") from None
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise OptionError(f"{path} is not a list of effects ({error}); see the effects.json of a gap report.") from None


def add_effects(spec: mujoco.MjSpec, effects: Iterable[Effect]) -> None:
    """Add effects to a model; neutral ones leave it untouched.

    Raises:
        JointMismatch: an effect names a joint that the model lacks.
    """
    chosen = sorted(effects, key=lambda effect: effect.late)
    if not all(effect.is_neutral for effect in chosen):
        settle_damping(spec)
    for effect in chosen:
        if effect.joint is not None and spec.joint(effect.joint) is None:
            names = ", ".join(joint.name for joint in spec.joints)
            raise JointMismatch(f"{effect.name()} names the joint '{effect.joint}'; the model has: {names}.")
        if not effect.is_neutral:
            effect.edit(spec)


def joint_actuator(spec: mujoco.MjSpec, joint: str) -> mujoco.MjsActuator:
    """Return the actuator that drives a joint; of several the first with position feedback.

    Raises:
        JointMismatch: no actuator does.
    """
    driving = [actuator for actuator in spec.actuators if driven_joint(spec, actuator) == joint]
    if not driving:
        raise JointMismatch(f"No actuator of the model drives the joint '{joint}'.")
    return min(driving, key=lambda actuator: actuator.biasprm[1] == 0)
