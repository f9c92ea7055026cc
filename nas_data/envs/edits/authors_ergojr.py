"""The ErgoJr of the paper's simulations: heavy motors behind stiff velocity control, and the target's drag.

Masses, gains and drags are those of the authors' PyBullet code. Approximated: their motor reaches a velocity of a tenth
of the error a control step in one solver pass with at most 1 N·m; here a position servo of that time constant, high
damping and the same limit does. Their drag is a fixed joint of bounded force whose pivot is 0.1 m off; here it is
Coulomb friction of that force on that lever. The brackets keep this project's masses, a few grams.
"""

import mujoco
import numpy as np

RATE = 10.0  # [1/s] of approach: position gain 0.1 a step of 10 ms, velocity gain 1
DAMPING = 1.0  # [N·m·s/rad] high enough for the approach to be of first order
TORQUE = 1.0  # [N·m] limit of every motor
MOTOR, HEAVY_MOTOR = 0.1, 0.2  # [kg] in source and target
TARGET_DAMPING = {"m1": 0.1, "m2": 0.1, "m3": 0.1}  # [N·m·s/rad]
TARGET_DRAG = {"m3": 0.08, "m6": 0.06}  # [N·m] forces of 0.8 and 0.6 N on a lever of 0.1 m


def authors_source(spec: mujoco.MjSpec) -> None:
    """Turn our ErgoJr into the authors' source."""
    set_motors(spec, MOTOR)
    for actuator in spec.actuators:
        actuator.set_to_position(kp=DAMPING * RATE, kv=DAMPING)
        actuator.forcerange = [-TORQUE, TORQUE]
    for joint in spec.joints:
        joint.damping, joint.frictionloss = np.zeros_like(joint.damping), 0.0


def authors_target(spec: mujoco.MjSpec) -> None:
    """Turn our ErgoJr into the authors' target."""
    authors_source(spec)
    set_motors(spec, HEAVY_MOTOR)
    for joint, damping in TARGET_DAMPING.items():
        values = spec.joint(joint).damping.copy()
        values[0] = damping
        spec.joint(joint).damping = values
    for joint, torque in TARGET_DRAG.items():
        spec.joint(joint).frictionloss = torque


def set_motors(spec: mujoco.MjSpec, mass: float) -> None:
    """Give every motor that moves a mass [kg]."""
    for geom in spec.geoms:
        if geom.name.startswith("motor") and geom.name != "motor1":
            geom.mass = mass
