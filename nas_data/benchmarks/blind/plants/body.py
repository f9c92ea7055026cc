"""The numbers of one arm with everything that hides in it, joint by joint, before they are stacked for a batch."""

from dataclasses import dataclass, fields

import numpy as np

from nas_data.benchmarks.blind.plants.constants import Constants
from nas_data.benchmarks.blind.plants.numbers import Hideable, Links, Servos
from nas_data.benchmarks.blind.plants.vectors import make_rotation
from nas_data.benchmarks.blind.truth import Base

NEUTRAL = {
    "viscous": 0.0, "stribeck": 0.0, "kinetic_ratio": 1.0, "stribeck_velocity": 1.0, "load_ratio": 0.0,
    "delay": 0.0, "speed": np.inf, "offset": 0.0, "deadband": 0.0, "play": 0.0, "spring": np.inf,
    "cogs": 0.0, "cog_count": 1.0, "cog_phase": 0.0, "cable": 0.0, "cable_angle": 0.0, "cable_side": 1.0,
}  # fmt: skip
FLANK, HARDER = 500.0, 190.0  # [N m/rad] 0.2 N m sink into a gear's flank by 0.02 degrees; least multiple of the gain
PENDULUM = {
    "damping": 2e-5,  # [N m s/rad] a weight on a pin swings for seconds
    "force": (0.0, 0.0),
    "control": (-np.inf, np.inf),
    "flank": FLANK,
}


@dataclass
class PlantBody(Hideable, Servos, Links):
    """One arm with what hides in it."""

    driven: int  # number of joints with a servo; a swinging load is one more, undriven

    @classmethod
    def of(cls, constants: Constants, base: Base) -> "PlantBody":
        """Return the nominal arm with its base parameters multiplied."""
        n = len(constants.joints)
        nominal = {key: np.array(value) for key, value in vars(constants).items() if key != "joints"}
        flank = np.maximum(FLANK, HARDER * constants.gain)  # a larger servo has larger teeth
        body = cls(**nominal, **{key: np.full(n, value) for key, value in NEUTRAL.items()}, flank=flank, driven=n)
        mass, damping = np.array(base.mass), np.array(base.damping)
        body.masses *= mass
        body.inertias *= mass[:, None, None]
        body.damping *= damping
        body.servo_damping *= damping
        body.armature *= base.armature
        body.gain *= base.stiffness
        return body

    def hang(self, mass: float, length: float, heading: float) -> None:
        """Hang a weight from the last link's centre of mass: one more link, a rod on a pin.

        Args:
            mass: Of the weight at the rod's end [kg].
            length: Of the rod [m].
            heading: Direction of the pin, as an angle about the last joint's axis [rad].
        """
        axis = self.axes[-1]
        across = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
        pin = make_rotation(axis, heading) @ (across / np.linalg.norm(across))
        rod = np.cross(pin, axis)  # perpendicular to the pin, so that the weight swings about it
        link = {"offsets": self.centres[-1], "turns": np.eye(3), "axes": pin, "masses": mass, "centres": length * rod}
        size = 1e-4 * mass * np.eye(3) * length**2 + 1e-8 * np.eye(3)
        rest = dict.fromkeys(("sliding", "armature", "friction", "gain", "motor", "servo_damping"), 0.0)
        for key, value in (link | {"inertias": size} | rest | NEUTRAL | PENDULUM).items():
            rows = getattr(self, key)
            setattr(self, key, np.concatenate([rows, np.asarray(value, rows.dtype)[None]]))


def stack_arms(bodies: list[PlantBody], repeats: int) -> dict[str, np.ndarray]:
    """Return each number of several arms with a leading axis, every arm repeated: (B, …)."""
    names = [field.name for field in fields(PlantBody) if field.name != "driven"]
    return {name: np.repeat(np.stack([getattr(body, name) for body in bodies]), repeats, axis=0) for name in names}
