"""What a gap report named: effects to add to a source, and base parameters that it has a little different."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import mujoco

from nas_data.effects.base import Effect, read_effects
from nas_data.errors import JointMismatch, OptionError
from nas_data.gap.nominal_parameters import apply_base, base_parameters
from nas_data.gap.write_model import EFFECTS, read_factors
from nas_data.mjcf.bake_inertia import bake_inertia
from nas_data.robots.base import Robot


@dataclass(frozen=True)
class Named:
    """The effects and the retuned base of one gap report.

    Attributes:
        path: File that they were read from.
        effects: The named effects.
        retuned: Factors of base parameters by name, for example `m2.damping`; those of 1 left out.
    """

    path: Path
    effects: tuple[Effect, ...]
    retuned: Mapping[str, float]

    @classmethod
    def read(cls, path: str | Path) -> "Named":
        """Read an `effects.json`, the one in a gap report's folder, or a `report.json`.

        Raises:
            OptionError: there is no such file, or it has another form.
        """
        path = Path(path)
        file = path / EFFECTS if path.is_dir() else path
        effects = tuple(effect for effect in read_effects(file) if not effect.is_neutral)
        retuned = {name: factor for name, factor in read_factors(file).items() if factor != 1}
        for name, factor in retuned.items():
            if not (math.isfinite(factor) and factor > 0):
                raise OptionError(f"{file} multiplies {name} by {factor}; a factor must be a number above 0.")
        return cls(file, effects, retuned)

    def robot(self, robot: Robot, joints: Sequence[str]) -> Robot:
        """Return a robot with the retuned base; the effects are left to the simulator.

        Args:
            robot: The plain source's.
            joints: Measured joints, by which the masses are told apart.

        Raises:
            JointMismatch: what was named belongs to another robot.
        """
        self._check(robot, joints)
        if not self.retuned:
            return robot
        kept = {name: getattr(robot, name) for name in Robot.__dataclass_fields__ if name != "edit"}
        edit = robot.edit or leave_unchanged  # with an edit, nobody takes the file alone for the model
        return RetunedRobot(**kept, edit=edit, factors=self.retuned, measured=tuple(joints))

    def _check(self, robot: Robot, joints: Sequence[str]) -> None:
        spec = robot.spec()
        known = {joint.name for joint in spec.joints}
        base = {parameter.name for parameter in base_parameters(bake_inertia(spec), joints)}
        strange = [f"the joint '{effect.joint}'" for effect in self.effects if effect.joint not in {None, *known}]
        strange += [f"the parameter '{name}'" for name in self.retuned if name not in base]
        if strange:
            raise JointMismatch(
                f"{self.path} is about another robot: it names {strange[0]}, which {robot.name} lacks "
                f"(its joints: {', '.join(joints)}); give a gap report of {robot.name}."
            )


def leave_unchanged(spec: mujoco.MjSpec) -> None:
    """Edit nothing."""


@dataclass(frozen=True)
class RetunedRobot(Robot):
    """A robot whose base parameters are multiplied by factors.

    Attributes:
        factors: By the parameters' names.
        measured: Measured joints.
    """

    factors: Mapping[str, float] = field(default_factory=dict)
    measured: tuple[str, ...] = ()

    def spec(self) -> mujoco.MjSpec:
        """Return a fresh, editable model."""
        spec = bake_inertia(super().spec())
        apply_base(spec, base_parameters(spec, self.measured), self.factors)
        return spec
