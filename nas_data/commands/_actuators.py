"""What commands that take a model share: which actuators a URDF has, which does not say it."""

from dataclasses import dataclass
from typing import Literal, overload

from nas_data.commands.base import Command
from nas_data.errors import OptionError


@dataclass(frozen=True, kw_only=True)
class TakesModel(Command):
    """A command one of whose options is a model."""

    actuators: Literal["position", "torque"] = "position"
    """What moves the joints of a URDF, which names none: position servos, or motors (torques; forces of slides)."""

    @overload
    def actuated(self, model: str) -> str: ...

    @overload
    def actuated(self, model: str | None) -> str | None: ...

    def actuated(self, model: str | None) -> str | None:
        """Return a model as `find_robot` takes it, with these actuators.

        Raises:
            OptionError: no model is given.
        """
        from nas_data.robots.base import TORQUES

        if self.actuators == "position":
            return model
        if model is None:
            raise OptionError("--actuators is for a URDF given with --model; without one, leave it out.")
        return model + TORQUES
