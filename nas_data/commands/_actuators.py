"""Option of commands that take a model: the actuators of a URDF, which defines none."""

from dataclasses import dataclass
from typing import Literal, overload

from nas_data.commands.base import Command
from nas_data.errors import OptionError


@dataclass(frozen=True, kw_only=True)
class TakesModel(Command):
    """A command with a model among its options."""

    actuators: Literal["position", "torque"] = "position"
    """Actuators for a URDF, which defines none: position servos, or motors (torques; forces for slides)."""

    @overload
    def actuated(self, model: str) -> str: ...

    @overload
    def actuated(self, model: str | None) -> str | None: ...

    def actuated(self, model: str | None) -> str | None:
        """Return a model with these actuators, as an argument of `find_robot`.

        Raises:
            OptionError: no model is given.
        """
        from nas_data.robots.base import TORQUES

        if self.actuators == "position":
            return model
        if model is None:
            raise OptionError("--actuators is for a URDF given with --model; without one, leave it out.")
        return model + TORQUES
