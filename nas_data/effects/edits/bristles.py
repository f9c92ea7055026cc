"""Friction of bristles, which fades with speed, as a passive actuator."""

import mujoco
import numpy as np

from nas_data.effects.edits.passive import add_passive
from nas_data.mjcf.unique_name import free_name

REST = 1e-3  # part of the bristles' friction that stays at speed; the engine divides by it
STIFF = 2.0  # stiffness times timestep²/inertia: at 1 a load may tear them off too soon, at 4 they would swing for ever


def add_bristles(spec: mujoco.MjSpec, joint: str, torque: float, velocity: float) -> None:
    """Add LuGre friction to a joint: `torque` [N·m] at rest, fading with exp(−(v / velocity)²), velocity in rad/s.

    The bristles are half as stiff as the timestep can bear on the inertia that the joint feels, so that they yield by
    less than a sensor sees, and have no damping of their own: the engine would treat it as inertia. The joint's
    friction loss keeps them quiet. As they feel only what moved, a load that jumps, within one step, to more than
    friction loss plus inertia · velocity / timestep tears them off.
    """
    stiffness = STIFF * felt_inertia(spec, joint) / spec.option.timestep**2
    lugre = np.array([stiffness, 0.0, REST * torque, torque, velocity])
    add_passive(spec, free_name(spec.actuator, f"{joint}_stribeck"), mujoco.mjtTrn.mjTRN_JOINT, joint, lugre)


def felt_inertia(spec: mujoco.MjSpec, joint: str) -> float:
    """Return the inertia [kg·m²] that a torque on one joint accelerates in the reference posture, all others free."""
    model = spec.compile()
    return 1 / float(model.dof_invweight0[model.joint(joint).dofadr[0]])
