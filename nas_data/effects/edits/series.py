"""A second hinge in series with a servo's joint: the link turns by the sum of both, and that sum is measured."""

import math

import mujoco

from nas_data.dataset.features import POSITION
from nas_data.drives import driving_actuators

SMALLEST = 2e-5  # [kg m²] a hinge that carries less inertia than this rings at 2 ms
STOP = (0.9999, 0.9999, 0.001, 0.5, 2.0)  # impedance that on the lightest link still holds the motor behind it
SURE = 0.5  # part of a link's inertia in the reference posture that it has in nearly all postures


def add_series_joint(spec: mujoco.MjSpec, joint: str, suffix: str) -> mujoco.MjsJoint:
    """Add the joint `<joint>_<suffix>` on the same body and axis, free and without friction, and measure the sum.

    The range of a servo bounds the servo's angle, and stays with its joint. A motor knows no angle: what bounds a joint
    that it drives is a stop, and the link is what meets it.

    Args:
        spec: Model.
        joint: The servo's joint; its actuator keeps driving and feeling that joint alone.
        suffix: What the second joint is.

    Returns:
        The second joint, or the one an earlier effect of the same kind added.
    """
    name = f"{joint}_{suffix}"
    if (existing := spec.joint(name)) is not None:
        return existing
    first, model = spec.joint(joint), spec.compile()
    # nothing may be left without any inertia: no servo without a rotor, no piece between two such hinges
    between = SMALLEST if len(first.parent.joints) > 1 else SMALLEST - first.armature
    armature = max(lacking_inertia(spec, joint, SMALLEST), between)
    second = first.parent.add_joint(name=name, type=first.type, pos=first.pos, axis=first.axis)
    if first.frame is not None:
        second.set_frame(first.frame)
    clear_defaults(second)
    second.armature = armature
    tendon = measured_tendon(spec, joint)
    if driven_by_torque(model, joint):
        stop_link(model, first, tendon)
    tendon.wrap_joint(name, 1.0)
    return second


def driven_by_torque(model: mujoco.MjModel, joint: str) -> bool:
    """Whether a motor drives a joint, and no servo that feels its position."""
    driving = driving_actuators(model, int(model.joint(joint).id))
    return len(driving) > 0 and not model.actuator_biasprm[driving, 1].any()


def stop_link(model: mujoco.MjModel, joint: mujoco.MjsJoint, tendon: mujoco.MjsTendon) -> None:
    """Let a joint's stops act on what is measured of it, the link, and on the motor no longer.

    Args:
        model: The model, compiled.
        joint: The motor's joint.
        tendon: Measures the link.
    """
    index = int(model.joint(joint.name).id)
    if not model.jnt_limited[index]:
        return
    joint.limited, tendon.limited = mujoco.mjtLimited.mjLIMITED_FALSE, mujoco.mjtLimited.mjLIMITED_TRUE
    tendon.range = model.jnt_range[index]  # [rad] whatever the file's unit: the compiler converts none of a tendon's
    tendon.margin, tendon.solref_limit, tendon.solimp_limit = joint.margin, joint.solref_limit, STOP


def lacking_inertia(spec: mujoco.MjSpec, joint: str, wanted: float) -> float:
    """Return the rotor inertia that a second hinge needs beside its link's for a wanted one [kg·m²]; often none."""
    model = spec.compile()
    dof = int(model.joint(joint).dofadr[0])
    return max(0.0, wanted - SURE * float(model.dof_M0[dof] - model.dof_armature[dof]))


def clear_defaults(joint: mujoco.MjsJoint) -> None:
    """Undo what the model's default class gives to every joint: springs, losses and limits."""
    for field in ("damping", "stiffness"):
        setattr(joint, field, [0.0] * 3)
    joint.frictionloss = joint.ref = joint.springref = joint.springyield = joint.margin = 0.0
    joint.limited = mujoco.mjtLimited.mjLIMITED_FALSE
    joint.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE
    joint.range = [0.0, 0.0]


def measured_tendon(spec: mujoco.MjSpec, joint: str) -> mujoco.MjsTendon:
    """Return the fixed tendon whose length is measured as `<joint>.pos`; made from the joint where there is none."""
    sensor = spec.sensor(joint + POSITION) or spec.add_sensor(name=joint + POSITION)
    if sensor.type == mujoco.mjtSensor.mjSENS_TENDONPOS:
        return spec.tendon(sensor.objname)
    tendon = spec.add_tendon(name=f"{joint}_link")
    tendon.wrap_joint(joint, 1.0)
    sensor.type = mujoco.mjtSensor.mjSENS_TENDONPOS
    sensor.objtype = mujoco.mjtObj.mjOBJ_TENDON
    sensor.objname = tendon.name
    return tendon


def angle(spec: mujoco.MjSpec, radians: float) -> float:
    """Return an angle in the unit in which the model's file is written."""
    return math.degrees(radians) if spec.compiler.degree else radians
