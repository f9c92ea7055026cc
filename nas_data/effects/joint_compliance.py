"""An elastic transmission between servo and link, without free play."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import mujoco

from nas_data.effects.base import Effect, Parameter, Scales
from nas_data.effects.edits.series import add_series_joint, compute_missing_armature

LOSS_TIME = 1e-3  # [s] damping over stiffness: damping ratio 0.05 at 100 rad/s, typical of plastic gears


@dataclass(frozen=True, kw_only=True)
class JointCompliance(Effect):
    """A spring between servo and link: a second hinge `<joint>_flex`; the link is measured."""

    stiffness: float

    parameters: ClassVar = (Parameter("stiffness", "N·m/rad", 0.05, 1e6, math.inf),)
    edit_order: ClassVar = 1
    equation: ClassVar = "q = q_servo + s, torque = stiffness · s + 1 ms · stiffness · ds/dt"
    source: ClassVar = "Flexible-joint model, Spong 1987 (doi:10.1115/1.3143860)"
    signature: ClassVar = (
        "Deflection proportional to load (gravity, acceleration) at any amplitude; a resonance that the servo "
        "cannot damp."
    )
    confused_with: ClassVar = ("backlash", "servo_stiffness", "payload")

    @classmethod
    def guesses(cls, scales: Scales) -> tuple[Mapping[str, float], ...]:
        """Springs from slightly to much stiffer than the servo."""
        return tuple({"stiffness": share * scales.stiffness} for share in (1.5, 5.0, 15.0))

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Add the spring to the model, in series with an existing one."""
        assert self.joint is not None
        flex = add_series_joint(spec, self.joint, "flex")
        present = float(flex.stiffness[0])
        total = self.stiffness * present / (self.stiffness + present) if present else self.stiffness
        flex.stiffness = [total, 0.0, 0.0]
        flex.damping = [total * LOSS_TIME, 0.0, 0.0]
        # the timestep must resolve the spring's oscillation; armature is added only if the link is too light for that
        flex.armature = max(flex.armature, compute_missing_armature(spec, self.joint, total * spec.option.timestep**2))
