"""The ErgoJr of the paper's simulations: heavy motors behind stiff velocity control, and the target's drag.

Only the commanded arm is changed, not an opponent in the scene.

Masses, gains and drags are those of the authors' PyBullet code, with two approximations. Their motor reaches a velocity
of a tenth of the error per control step, with at most 1 N·m; here a position servo has that time constant, high damping
and the same limit. Their drag is a fixed joint of bounded force with a pivot 0.1 m away; here it is Coulomb friction of
that force on that lever. The brackets keep this project's masses of a few grams.

On ErgoShield their target was the real arm; its motion is known from their recordings, see `authors_arm`.
"""

import mujoco
import numpy as np

from nas_data.robots.ergojr import JOINTS

RATE = 10.0  # [1/s] of approach: position gain 0.1 a step of 10 ms, velocity gain 1
DAMPING = 1.0  # [N·m·s/rad] high enough for the approach to be of first order
TORQUE = 1.0  # [N·m] limit of every motor
MOTOR, HEAVY_MOTOR = 0.1, 0.2  # [kg] in source and target
TARGET_DAMPING = {"m1": 0.1, "m2": 0.1, "m3": 0.1}  # [N·m·s/rad]
STIFFNESS, VISCOSITY = 10.0, 0.2  # [N·m/rad], [N·m·s/rad] of servos that integrate what gravity leaves
STALL_TORQUE = 0.39  # [N·m] at 7.4 V, XL-320 e-manual
TARGET_DRAG = {"m3": 0.08, "m6": 0.06}  # [N·m] forces of 0.8 and 0.6 N on a lever of 0.1 m


def authors_source(spec: mujoco.MjSpec) -> None:
    """Change the ErgoJr model to the authors' source."""
    set_motors(spec, MOTOR)
    set_servos(spec, DAMPING * RATE, DAMPING, TORQUE)
    for joint in map(spec.joint, JOINTS):
        joint.damping, joint.frictionloss = np.zeros_like(joint.damping), 0.0


def authors_target(spec: mujoco.MjSpec) -> None:
    """Change the ErgoJr model to the authors' target."""
    authors_source(spec)
    set_motors(spec, HEAVY_MOTOR)
    for joint, damping in TARGET_DAMPING.items():
        values = spec.joint(joint).damping.copy()
        values[0] = damping
        spec.joint(joint).damping = values
    for joint, torque in TARGET_DRAG.items():
        spec.joint(joint).frictionloss = torque


def authors_arm(spec: mujoco.MjSpec) -> None:
    """Change the ErgoJr model to hold postures as the authors' real arm did, within a degree of the command.

    Their servos had integral gain (Poppy's configuration: P 4, I 2). The model has none and would sag; a higher
    stiffness replaces the integral. Speed and delay are effects; see `envs/ergo_shield.py`.
    """
    set_servos(spec, STIFFNESS, VISCOSITY, STALL_TORQUE)


def set_servos(spec: mujoco.MjSpec, stiffness: float, damping: float, torque: float) -> None:
    """Set stiffness [N·m/rad], damping [N·m·s/rad] and torque limit [N·m] of every servo."""
    for actuator in map(spec.actuator, JOINTS):
        actuator.set_to_position(kp=stiffness, kv=damping)
        actuator.forcerange = [-torque, torque]


def set_motors(spec: mujoco.MjSpec, mass: float) -> None:
    """Set the mass [kg] of every moving motor."""
    for geom in spec.geoms:
        if geom.name.startswith("motor") and geom.name != "motor1":
            geom.mass = mass
