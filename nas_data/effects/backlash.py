"""Free play between servo and link."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import mujoco

from nas_data.effects.base import Effect, Parameter, Scales
from nas_data.effects.edits.series import add_series_joint, to_file_unit
from nas_data.effects.edits.stops import HARD_STOP, soften_stops
from nas_data.mjcf.actuator_lookup import WIDEST_PLAY

NARROWEST = 1e-6  # [rad] MuJoCo needs a range, and yielding stops may have no play between them


@dataclass(frozen=True, kw_only=True)
class Backlash(Effect):
    """The link lags behind the servo by up to `half_width` and changes sides when the load on it reverses.

    The model is a second hinge `<joint>_play` with stops. The servo controls its own side; the link is measured. The
    stops are rigid, or they yield with `stiffness`, as teeth and shafts do. Both are critically damped.
    """

    half_width: float
    stiffness: float = math.inf

    parameters: ClassVar = (
        Parameter("half_width", "rad", 0.0, WIDEST_PLAY, 0.0),
        Parameter("stiffness", "N·m/rad", 0.05, 1e6, math.inf, spread=math.inf),
    )
    edit_order: ClassVar = 1
    equation: ClassVar = (
        "q = q_servo + p, |p| ≤ half_width; with a stiffness, torque = stiffness · (|p| − half_width) · sign(p) beyond"
    )
    source: ClassVar = "MuJoCo documentation, Modeling, Backlash: two hinges on one axis"
    signature: ClassVar = (
        "A dead width after every reversal, the same in degrees at every speed; closed where gravity preloads one side."
    )
    confused_with: ClassVar = ("coulomb_friction", "joint_compliance", "deadband")

    @classmethod
    def guesses(cls, scales: Scales) -> tuple[Mapping[str, float], ...]:
        """Half a degree to four degrees, from small to worn gears."""
        return tuple({"half_width": width * scales.radian} for width in (0.008, 0.025, 0.07))

    @classmethod
    def optional_guess(cls, scales: Scales | None) -> Mapping[str, float]:
        """Stops that are ten times as stiff as the servo."""
        return {"stiffness": 10.0 * scales.stiffness} if scales else {}

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Add the play, or widen existing play; stops in series with existing ones yield more."""
        assert self.joint is not None
        play = add_series_joint(spec, self.joint, "play")
        play.limited = mujoco.mjtLimited.mjLIMITED_TRUE
        width = float(play.range[1]) + to_file_unit(spec, play, max(self.half_width, NARROWEST))
        play.range = [-width, width]
        if play.solref_limit[0] > 0:  # else the stops yield already
            # a stiffer stop overshoots between two physics steps
            play.solref_limit = [2 * spec.option.timestep, 1.0]
            play.solimp_limit = HARD_STOP
        if math.isfinite(self.stiffness):
            soften_stops(spec, play, self.stiffness)
