"""Friction constraints that are stiff enough to hold a load without visible creep."""

import mujoco
import numpy as np

HOLDING_IMPEDANCE = 0.999  # impedance (solimp) with which a joint creeps at 2e-6 · torque / inertia [rad/s]


def stiffen_friction(spec: mujoco.MjSpec, joint: str, least: float = HOLDING_IMPEDANCE) -> None:
    """Give the friction constraint of a joint at least an impedance, and a time constant of two timesteps."""
    element = spec.joint(joint)
    impedance = element.solimp_friction.copy()
    impedance[:2] = np.maximum(impedance[:2], least)
    element.solimp_friction = impedance
    if element.solref_friction[0] > 0:  # a negative value is a stiffness, which the author set on purpose
        element.solref_friction = [2 * spec.option.timestep, 1.0]
