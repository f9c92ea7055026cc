"""A mass that the model does not know of, carried by the last link."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np

from nas_data.effects.base import Effect, Parameter, Scales
from nas_data.errors import ModelFileError
from nas_data.robots.base import actuated_joints

NAME = "payload"
RADIUS = 0.005  # [m] of the sphere that stands for the mass; gives it the little inertia a body must have


@dataclass(frozen=True, kw_only=True)
class Payload(Effect):
    """A small sphere in the centre of mass of what the last actuated joint moves."""

    mass: float

    parameters: ClassVar = (Parameter("mass", "kg", 0.0, 5.0, 0.0),)
    whole_arm: ClassVar = True
    per_joint: ClassVar = False
    strains: ClassVar = "mass"
    equation: ClassVar = "gravity and inertia of a point mass at the last link's centre of mass"
    source: ClassVar = "Rigid-body mechanics"
    signature: ClassVar = "Droop that goes with the posture, at every joint below it, and slower acceleration."
    confused_with: ClassVar = ("base_tilt", "servo_stiffness", "rotor_inertia", "torque_limit")

    @classmethod
    def guesses(cls, scales: Scales) -> tuple[Mapping[str, float], ...]:
        """Half and twice the last link."""
        return tuple({"mass": share * scales.mass} for share in (0.5, 2.0))

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Add the mass to the model; a payload that is there already becomes heavier."""
        payload = spec.body(NAME)
        if payload is None:
            place = last_centre(spec)
            payload = spec.body(place[0]).add_body(name=NAME, pos=place[1], explicitinertial=True)
            payload.mass, payload.ipos = 0.0, np.zeros(3)
        payload.mass = payload.mass + self.mass
        payload.inertia = np.full(3, 0.4 * payload.mass * RADIUS**2)


def last_centre(spec: mujoco.MjSpec) -> tuple[str, np.ndarray]:
    """Return the body that the last actuated joint moves and where its subtree's centre of mass lies in it [m].

    Raises:
        ModelFileError: the model has no actuated joint.
    """
    joints = actuated_joints(spec)
    if not joints:
        raise ModelFileError("payload needs a model with an actuated joint.")
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    body = int(model.jnt_bodyid[model.joint(joints[-1]).id])
    world = data.subtree_com[body] - data.xpos[body]
    return model.body(body).name, data.xmat[body].reshape(3, 3).T @ world
