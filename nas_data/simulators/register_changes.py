"""Changes of a model by servo registers: their interface, and those that multiply the model's own value."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import mujoco


@dataclass(frozen=True)
class Setting:
    """A register of a joint's servo, and the model that is to have it.

    Attributes:
        spec: Model.
        joint: Joint.
        value: Value of the register in the recording.
        own: Value for which the model holds; None if unknown.
        torque_limit: Value of the register of the torque limit for which the model holds; None if unknown.
    """

    spec: mujoco.MjSpec
    joint: str
    value: float
    own: float | None
    torque_limit: float | None


class RegisterChange(ABC):
    """How a register changes a model.

    Attributes:
        is_relative: Whether it multiplies the model's value, so that the model must state its own register.
    """

    is_relative: ClassVar[bool] = False

    @abstractmethod
    def is_in(self, spec: mujoco.MjSpec, joint: str) -> bool:
        """Whether the model has what the register sets, for example a speed limit."""

    def is_none(self, setting: Setting) -> bool:
        """Whether the register's value switches off what it sets; for most, 0 does."""
        return setting.value == 0

    @abstractmethod
    def find_obstacle(self, setting: Setting) -> str:
        """Return why the model cannot have the register's value, as the end of a sentence; empty if it can."""

    @abstractmethod
    def edit(self, setting: Setting) -> None:
        """Give the model the register's value."""

    @abstractmethod
    def describe(self, setting: Setting) -> str:
        """Return the sentence of the change, without a full stop."""


@dataclass(frozen=True)
class RegisterRatio(RegisterChange):
    """A part of the servo that is proportional to its register.

    Attributes:
        words: Its name.
        scale: Function that multiplies it in a joint's servo.
        has_part: Whether a joint's servo has it; None if each has.
    """

    words: str
    scale: Callable[[mujoco.MjSpec, str, float], None]
    has_part: Callable[[mujoco.MjSpec, str], bool] | None = None

    is_relative: ClassVar[bool] = True

    def is_in(self, spec: mujoco.MjSpec, joint: str) -> bool:
        """Whether the servo has this part."""
        return self.has_part is None or self.has_part(spec, joint)

    def find_obstacle(self, setting: Setting) -> str:
        """Return why the part cannot be multiplied: there is none, or the ratio is infinite."""
        if not self.is_in(setting.spec, setting.joint):
            return f"the model's servo has no {self.words}"
        return "the model states 0, which has no multiples" if setting.own == 0 else ""

    def edit(self, setting: Setting) -> None:
        """Multiply the part."""
        self.scale(setting.spec, setting.joint, self._compute_factor(setting))

    def describe(self, setting: Setting) -> str:
        """Return the factor in words."""
        return f"the {self.words} is multiplied by {self._compute_factor(setting):.3g}"

    def _compute_factor(self, setting: Setting) -> float:
        assert setting.own is not None  # a relative register without it is not used
        return setting.value / setting.own


@dataclass(frozen=True)
class Unusable(RegisterChange):
    """A register that no model has.

    Attributes:
        reason: Why, as the end of a sentence.
    """

    reason: str

    def is_in(self, spec: mujoco.MjSpec, joint: str) -> bool:
        """Return False."""
        return False

    def find_obstacle(self, setting: Setting) -> str:
        """Return the reason."""
        return self.reason

    def edit(self, setting: Setting) -> None:
        """Change nothing."""

    def describe(self, setting: Setting) -> str:
        """Return an empty sentence."""
        return ""
