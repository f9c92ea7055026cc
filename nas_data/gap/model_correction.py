"""Named effects and retuned base parameters of a gap report, as an addition to a source."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import mujoco

from nas_data.effects.base import Effect, read_effects
from nas_data.errors import JointMismatch, OptionError
from nas_data.gap.nominal_parameters import FIRM, list_base_parameters, scale_base_parameters
from nas_data.gap.write_model import EFFECTS, read_factors, read_register_values
from nas_data.mjcf.bake_inertia import bake_inertia
from nas_data.robots.base import Robot
from nas_data.simulators.servo_registers import NO_REGISTERS, ServoRegisters


@dataclass(frozen=True)
class ModelCorrection:
    """Effects and retuned base parameters of one gap report.

    Attributes:
        path: File that they were read from.
        effects: Named effects.
        retuned: Factors of base parameters by name, for example `m2.damping`, without those equal to 1.
        registers: Servo registers of the recording, which come before both.
    """

    path: Path
    effects: tuple[Effect, ...]
    retuned: Mapping[str, float]
    registers: ServoRegisters = NO_REGISTERS

    @classmethod
    def read(cls, path: str | Path) -> "ModelCorrection":
        """Read an `effects.json`, the one in a gap report's folder, or a `report.json`.

        Raises:
            OptionError: the file is missing or malformed.
        """
        path = Path(path)
        file = path / EFFECTS if path.is_dir() else path
        effects = tuple(effect for effect in read_effects(file) if not effect.is_neutral)
        retuned = {name: factor for name, factor in read_factors(file).items() if factor != 1}
        for name, factor in retuned.items():
            if not (math.isfinite(factor) and factor > 0):
                raise OptionError(f"{file} multiplies {name} by {factor}; a factor must be a number above 0.")
        return cls(file, effects, retuned, ServoRegisters(read_register_values(file)))

    def robot(self, robot: Robot, joints: Sequence[str]) -> Robot:
        """Return a robot with registers and retuned base parameters; the simulator adds the effects.

        Args:
            robot: Robot of the source.
            joints: Measured joints, which define the masses.

        Raises:
            JointMismatch: the report is about another robot.
        """
        self.check(robot, joints)
        robot = self.registers.set_in(robot)
        if not self.retuned:
            return robot
        kept = {name: getattr(robot, name) for name in Robot.__dataclass_fields__ if name != "edit"}
        edit = robot.edit or (lambda _: None)  # an edit marks that the file alone is not the model
        return RetunedRobot(**kept, edit=edit, factors=self.retuned, measured=tuple(joints))

    def check(self, robot: Robot, joints: Sequence[str]) -> None:
        """Refuse a report about another robot.

        Args:
            robot: Robot of the source.
            joints: Measured joints, which define the masses.

        Raises:
            JointMismatch: names a joint or parameter that the robot lacks.
        """
        spec = robot.spec()
        known = {joint.name for joint in spec.joints}
        base = {parameter.name for parameter in list_base_parameters(bake_inertia(spec), joints)}
        base |= {joint + FIRM for joint in known}
        strange = [f"the joint '{effect.joint}'" for effect in self.effects if effect.joint not in {None, *known}]
        strange += [f"the parameter '{name}'" for name in self.retuned if name not in base]
        if strange:
            raise JointMismatch(
                f"{self.path} is about another robot: it names {strange[0]}, which {robot.name} lacks "
                f"(its joints: {', '.join(joints)}); give a gap report of {robot.name}."
            )


@dataclass(frozen=True)
class RetunedRobot(Robot):
    """A robot whose base parameters are multiplied by factors.

    Attributes:
        factors: Factors by parameter name.
        measured: Measured joints.
    """

    factors: Mapping[str, float] = field(default_factory=dict)
    measured: tuple[str, ...] = ()

    def spec(self) -> mujoco.MjSpec:
        """Return a fresh, editable model."""
        spec = bake_inertia(super().spec())
        scale_base_parameters(spec, list_base_parameters(spec, self.measured), self.factors)
        return spec
