"""Default actuators for a URDF, which defines joints and limits but no actuators."""

import mujoco
import numpy as np

BANDWIDTH = 50.0  # [rad/s] about 8 Hz: a step settles within 0.1 s, and gravity causes a few degrees of droop
DAMPING_RATIO = 1.0  # no overshoot


def add_position_servos(spec: mujoco.MjSpec) -> None:
    """Add a critically damped position servo, named after its joint, to every joint that is no follower.

    The stiffness is the joint's inertia in the reference posture times the squared bandwidth. The effort limit of the
    URDF's joint limits the torque, and its range limits the command.
    """
    model = spec.copy().compile()
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    for name in find_motor_joints(spec):
        joint, compiled = spec.joint(name), model.joint(name)
        inertia = float(model.dof_M0[compiled.dofadr[0]])
        servo = spec.add_actuator(name=joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        servo.set_to_position(kp=inertia * BANDWIDTH**2, kv=2 * DAMPING_RATIO * inertia * BANDWIDTH)
        if model.jnt_limited[compiled.id]:
            servo.ctrllimited = mujoco.mjtLimited.mjLIMITED_TRUE
            servo.ctrlrange = np.array(model.jnt_range[compiled.id])


def add_torque_motors(spec: mujoco.MjSpec) -> None:
    """Add a torque [N·m] or force [N] motor, named after its joint, to every joint that is no follower.

    The effort limit of the URDF's joint limits the command.
    """
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    for name in find_motor_joints(spec):
        joint = spec.joint(name)
        motor = spec.add_actuator(name=joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        motor.set_to_motor()
        if np.any(joint.actfrcrange):
            motor.ctrllimited, motor.ctrlrange = mujoco.mjtLimited.mjLIMITED_TRUE, np.array(joint.actfrcrange)


def find_motor_joints(spec: mujoco.MjSpec) -> tuple[str, ...]:
    """Return the names of the hinges and slides of a URDF that do not mimic another joint.

    MuJoCo imports `<mimic>` as an equality constraint whose first joint follows the second.
    """
    followers = {each.name1 for each in spec.equalities if each.type == mujoco.mjtEq.mjEQ_JOINT and each.name2}
    moving = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
    return tuple(joint.name for joint in spec.joints if joint.type in moving and joint.name not in followers)
