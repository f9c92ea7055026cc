"""An unmodelled mass on a link."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np

from nas_data.effects.base import Effect, Parameter, Scales
from nas_data.errors import ModelFileError
from nas_data.mjcf.arm_ends import list_arm_ends
from nas_data.mjcf.unique_name import make_unique_name
from nas_data.robots.base import find_deepest_joint, list_arm_joints

NAME = "payload"
TYPICAL_DISTANCE = 0.05  # [m] typical distance of a payload from the last link's centre of mass
RADIUS = 0.005  # [m] of the sphere, which gives the body the inertia that MuJoCo requires


@dataclass(frozen=True, kw_only=True)
class Payload(Effect):
    """A small sphere on the arm's outermost link, or the link of `joint`, at `x`, `y`, `z` from its centre of mass.

    The centre is that of the link with all that it carries, such as fingers; `x`, `y` and `z` are in the link's frame.
    `nas gap` looks for one on each arm of a robot with several.
    """

    mass: float
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0

    parameters: ClassVar = (
        Parameter("mass", "kg", 0.0, 100.0, 0.0),
        *(Parameter(axis, "m", -0.5, 0.5, 0.0, spread=TYPICAL_DISTANCE) for axis in "xyz"),
    )
    whole_arm: ClassVar = True
    per_joint: ClassVar = False
    per_link: ClassVar = True
    distorts: ClassVar = "mass"
    equation: ClassVar = "gravity and inertia of a point mass at the link's centre of mass + (x, y, z)"
    source: ClassVar = "Rigid-body mechanics"
    signature: ClassVar = "Droop that goes with the posture, at every joint below it, and slower acceleration."
    confused_with: ClassVar = ("base_tilt", "servo_stiffness", "rotor_inertia", "torque_limit")

    @classmethod
    def guesses(cls, scales: Scales) -> tuple[Mapping[str, float], ...]:
        """Half and twice the mass of the last link."""
        return tuple({"mass": share * scales.mass} for share in (0.5, 2.0))

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Add the mass, in addition to existing payloads."""
        link, centre = find_last_centre(spec, self.joint)
        body = link.add_body(name=make_unique_name(spec.body, NAME), explicitinertial=True)
        body.pos = centre + np.array([self.x, self.y, self.z])
        body.mass, body.ipos = self.mass, np.zeros(3)
        body.inertia = np.full(3, 0.4 * self.mass * RADIUS**2)


def find_last_centre(spec: mujoco.MjSpec, joint: str | None) -> tuple[mujoco.MjsBody, np.ndarray]:
    """Return the body of a joint, and the centre of mass of its subtree in its frame [m], shape (3,).

    Args:
        spec: Model.
        joint: Joint; None for the outermost last joint of an arm.

    Raises:
        ModelFileError: the model has no actuated joint.
    """
    joints = list_arm_joints(spec)
    if not joints:
        raise ModelFileError("payload needs a model with an actuated joint.")
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    body = int(model.jnt_bodyid[model.joint(joint or find_deepest_joint(spec, list_arm_ends(spec, joints))).id])
    world = data.subtree_com[body] - data.xpos[body]
    return spec.bodies[body], data.xmat[body].reshape(3, 3).T @ world
