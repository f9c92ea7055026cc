"""An effect of one's own: a cable that pulls a joint back, recorded, fitted and written into a model."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import mujoco
import numpy as np
from scipy.optimize import minimize_scalar

import nas_data as nas
from nas_data.effects.base import Effect, Parameter, add_effects
from nas_data.robots.base import find_robot


@dataclass(frozen=True, kw_only=True)
class CablePull(Effect):
    """A weak spring about the joint's zero, beside the servo: torque = −stiffness · q."""

    stiffness: float

    parameters: ClassVar = (Parameter("stiffness", "N·m/rad", 0.0, 1.0, neutral=0.0),)

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Add the stiffness to the joint's own."""
        joint = spec.joint(self.joint)
        joint.stiffness[0] += self.stiffness


def main() -> None:
    """Hide the cable in a recording, find its stiffness, and write the model that has it."""
    # The name of the effect is its class's: CablePull is cable_pull.
    ds = nas.record("pendulum", effects=["cable_pull:joint=pendulum,stiffness=0.3"], excitation="steps", rate=50)
    print(ds)

    def error(stiffness: float) -> float:
        """Return the one-step error [°] of a model with such a cable."""
        paired = nas.pair(ds, "pendulum", effects=[CablePull(joint="pendulum", stiffness=stiffness)])
        return float(np.degrees(np.sqrt(np.mean((paired.sim_states - paired.next_states)[:, 0] ** 2))))

    best = minimize_scalar(error, bounds=(0, 1), method="bounded", options={"xatol": 1e-3})
    print(f"without the cable: {error(0):.4f}°; with {best.x:.3f} N·m/rad: {best.fun:.4f}° (true: 0.3)")

    # An effect is an edit of the model, so plain MuJoCo runs it.
    spec = find_robot("pendulum").spec()
    add_effects(spec, [CablePull(joint="pendulum", stiffness=best.x)])
    spec.compile()
    Path("pendulum_with_cable.xml").write_text(spec.to_xml(), encoding="utf-8")
    print("pendulum_with_cable.xml loads in plain MuJoCo")


if __name__ == "__main__":
    main()
