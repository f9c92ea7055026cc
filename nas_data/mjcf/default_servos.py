"""Actuators for a model that has none: a URDF names joints and limits, but not what moves them."""

import mujoco
import numpy as np

BANDWIDTH = 50.0  # [rad/s] about 8 Hz: a step is done within 0.1 s, droop under gravity stays at a few degrees
DAMPING_RATIO = 1.0  # no overshoot


def add_position_servos(spec: mujoco.MjSpec) -> None:
    """Give every hinge and slide with a motor a critically damped position servo, named after its joint.

    Its stiffness is the joint's inertia in the reference posture times the bandwidth squared. The effort limit of
    the URDF's joint limits it, its range limits the command.
    """
    model = spec.copy().compile()
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    for name in motor_joints(spec):
        joint, compiled = spec.joint(name), model.joint(name)
        inertia = float(model.dof_M0[compiled.dofadr[0]])
        servo = spec.add_actuator(name=joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        servo.set_to_position(kp=inertia * BANDWIDTH**2, kv=2 * DAMPING_RATIO * inertia * BANDWIDTH)
        if model.jnt_limited[compiled.id]:
            servo.ctrllimited = mujoco.mjtLimited.mjLIMITED_TRUE
            servo.ctrlrange = np.array(model.jnt_range[compiled.id])


def add_torque_motors(spec: mujoco.MjSpec) -> None:
    """Give every hinge and slide with a motor one that takes torques [N·m] or forces [N], named after its joint.

    The effort limit of the URDF's joint limits the command.
    """
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    for name in motor_joints(spec):
        joint = spec.joint(name)
        motor = spec.add_actuator(name=joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        motor.set_to_motor()
        if np.any(joint.actfrcrange):
            motor.ctrllimited, motor.ctrlrange = mujoco.mjtLimited.mjLIMITED_TRUE, np.array(joint.actfrcrange)


def motor_joints(spec: mujoco.MjSpec) -> tuple[str, ...]:
    """Return the names of the hinges and slides that a URDF gives a motor: those that do not mimic another.

    MuJoCo makes of `<mimic>` an equality constraint whose first joint follows the second.
    """
    followers = {each.name1 for each in spec.equalities if each.type == mujoco.mjtEq.mjEQ_JOINT and each.name2}
    moving = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
    return tuple(joint.name for joint in spec.joints if joint.type in moving and joint.name not in followers)
