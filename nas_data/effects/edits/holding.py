"""Friction that holds a load still, not almost still."""

import mujoco
import numpy as np

FIRM = 0.999  # impedance: a joint at its friction creeps by 2e-6 · torque / inertia, in rad/s


def hold_firmly(spec: mujoco.MjSpec, joint: str) -> None:
    """Let the friction loss of a joint hold, also one that is set or exceeded only later."""
    held = spec.joint(joint)
    impedance = held.solimp_friction.copy()
    impedance[:2] = np.maximum(impedance[:2], FIRM)
    held.solimp_friction = impedance
    if held.solref_friction[0] > 0:  # a negative one is a stiffness, which somebody chose on purpose
        held.solref_friction = [2 * spec.option.timestep, 1.0]
