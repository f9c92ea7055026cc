"""Free play between servo and link."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import mujoco

from nas_data.effects.base import Effect, Parameter, Scales
from nas_data.effects.edits.series import add_series_joint, to_file_unit
from nas_data.mjcf.actuator_lookup import WIDEST_PLAY

HARD_STOP = (0.99, 0.999, 0.001, 0.5, 2.0)  # solimp: the servo's torque deforms the stop by less than 1e-4 rad


@dataclass(frozen=True, kw_only=True)
class Backlash(Effect):
    """The link lags behind the servo by up to `half_width` and changes sides when the load on it reverses.

    The model is a second hinge `<joint>_play` with hard stops. The servo controls its own side; the link is measured.
    """

    half_width: float

    parameters: ClassVar = (Parameter("half_width", "rad", 0.0, WIDEST_PLAY, 0.0),)
    edit_order: ClassVar = 1
    equation: ClassVar = "q = q_servo + p, |p| ≤ half_width"
    source: ClassVar = "MuJoCo documentation, Modeling, Backlash: two hinges on one axis"
    signature: ClassVar = (
        "A dead width after every reversal, the same in degrees at every speed; closed where gravity preloads one side."
    )
    confused_with: ClassVar = ("coulomb_friction", "joint_compliance", "deadband")

    @classmethod
    def guesses(cls, scales: Scales) -> tuple[Mapping[str, float], ...]:
        """Half a degree to four degrees, from small to worn gears."""
        return tuple({"half_width": width * scales.radian} for width in (0.008, 0.025, 0.07))

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Add the play, or widen existing play."""
        assert self.joint is not None
        play = add_series_joint(spec, self.joint, "play")
        play.limited = mujoco.mjtLimited.mjLIMITED_TRUE
        width = float(play.range[1]) + to_file_unit(spec, self.half_width)
        play.range = [-width, width]
        # a stiffer stop overshoots between two physics steps
        play.solref_limit = [2 * spec.option.timestep, 1.0]
        play.solimp_limit = HARD_STOP
