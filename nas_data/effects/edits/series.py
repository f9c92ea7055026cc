"""A second hinge in series with a servo's joint: the link turns by the sum of both, and that sum is measured."""

import math

import mujoco

from nas_data.dataset.features import POSITION

SMALLEST = 2e-5  # [kg m²] a hinge that carries less inertia than this rings at 2 ms
SURE = 0.5  # part of a link's inertia in the reference posture that it has in nearly all postures


def add_series_joint(spec: mujoco.MjSpec, joint: str, suffix: str) -> mujoco.MjsJoint:
    """Add the joint `<joint>_<suffix>` on the same body and axis, free and without friction, and measure the sum.

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
    first = spec.joint(joint)
    # nothing may be left without any inertia: no servo without a rotor, no piece between two such hinges
    between = SMALLEST if len(first.parent.joints) > 1 else SMALLEST - first.armature
    armature = max(lacking_inertia(spec, joint, SMALLEST), between)
    second = first.parent.add_joint(name=name, type=first.type, pos=first.pos, axis=first.axis)
    if first.frame is not None:
        second.set_frame(first.frame)
    clear_defaults(second)
    second.armature = armature
    measured_tendon(spec, joint).wrap_joint(name, 1.0)
    return second


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
