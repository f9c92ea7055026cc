"""A second joint in series with a servo's joint: the link moves by the sum of both, which is measured."""

import math
import re

import mujoco
import numpy as np

from nas_data.dataset.features import POSITION
from nas_data.effects.edits.pristine import JOINT, clear_joint, clear_tendon
from nas_data.mjcf.actuator_lookup import find_driven_joint
from nas_data.mjcf.unique_name import make_unique_name

SMALLEST = 2e-5  # [kg m²] a hinge with less inertia oscillates at a timestep of 2 ms
STOP = (0.9999, 0.9999, 0.001, 0.5, 2.0)  # solimp of a stop that holds the motor even through a very light link
MIN_INERTIA_SHARE = 0.5  # share of a link's inertia in the reference posture that nearly all postures exceed


def add_series_joint(spec: mujoco.MjSpec, joint: str, suffix: str) -> mujoco.MjsJoint:
    """Add the joint `<joint>_<suffix>` on the same body and axis, free and without friction, and measure the sum.

    The joint range of a position servo limits the servo's angle and stays with its joint. The joint range of a torque
    motor is a mechanical stop for the link and moves to the sum.

    Args:
        spec: Model.
        joint: The servo's joint, on which its actuator continues to act.
        suffix: Suffix of the second joint.

    Returns:
        The second joint, or the one that an earlier effect of the same type added.
    """
    if (existing := find_series_joint(spec, joint, suffix)) is not None:
        return existing
    first = spec.joint(joint)
    motor = spec.compile() if is_torque_driven(spec, joint) else None
    # neither a servo without armature nor a piece between two such hinges may be without inertia
    between = SMALLEST if len(first.parent.joints) > 1 else SMALLEST - first.armature
    armature = max(compute_missing_armature(spec, joint, SMALLEST), between)
    second = insert_joint(spec, first, make_unique_name(spec.joint, f"{joint}_{suffix}"))
    second.type, second.pos, second.axis = first.type, first.pos, first.axis
    if first.frame is not None:
        second.set_frame(first.frame)
    clear_joint(second)
    second.armature = armature
    tendon = ensure_measured_tendon(spec, joint)
    if motor is not None:
        move_stops(motor, first, tendon)
    tendon.wrap_joint(second.name, 1.0)
    return second


def is_torque_driven(spec: mujoco.MjSpec, joint: str) -> bool:
    """Whether a joint is driven, but by no actuator with position feedback."""
    driving = [actuator for actuator in spec.actuators if find_driven_joint(spec, actuator) == joint]
    return bool(driving) and not any(actuator.biasprm[1] for actuator in driving)


def move_stops(model: mujoco.MjModel, joint: mujoco.MjsJoint, tendon: mujoco.MjsTendon) -> None:
    """Move a joint's stops to the measured link.

    Args:
        model: Compiled model before the edit.
        joint: The motor's joint.
        tendon: Tendon that measures the link.
    """
    index = int(model.joint(joint.name).id)
    if not model.jnt_limited[index]:
        return
    joint.limited, tendon.limited = mujoco.mjtLimited.mjLIMITED_FALSE, mujoco.mjtLimited.mjLIMITED_TRUE
    tendon.range = model.jnt_range[index]  # [rad] the compiler does not convert tendon ranges from degrees
    tendon.margin, tendon.solref_limit, tendon.solimp_limit = joint.margin, joint.solref_limit, STOP


def insert_joint(spec: mujoco.MjSpec, first: mujoco.MjsJoint, name: str) -> mujoco.MjsJoint:
    """Add a joint to a body directly after another one, so that later joints about other axes do not turn its axis.

    MuJoCo only appends joints, so that later joints are recreated after it.
    """
    joints = first.parent.joints
    later = joints[[joint.name for joint in joints].index(first.name) + 1 :]
    while later and has_same_axis(later[0], first):
        del later[0]
    added = first.parent.add_joint(name=name)
    for joint in later:
        move_to_end(spec, joint)
    return added


def has_same_axis(one: mujoco.MjsJoint, other: mujoco.MjsJoint) -> bool:
    """Whether two joints of a body have the same type and axis, so that their order does not matter."""
    fields = ("type", "pos", "axis")
    equal = all(np.array_equal(getattr(one, field), getattr(other, field)) for field in fields)
    frames = [joint.frame and joint.frame.signature for joint in (one, other)]
    return equal and frames[0] == frames[1]


def move_to_end(spec: mujoco.MjSpec, joint: mujoco.MjsJoint) -> None:
    """Make a joint the last one of its body; references by its name stay valid."""
    name, joint.name = joint.name, ""
    moved = joint.parent.add_joint(joint.classname, name=name)
    for field in (*JOINT, "type", "pos", "axis", "limited", "actfrclimited", "userdata", "info"):
        setattr(moved, field, getattr(joint, field))
    if joint.frame is not None:
        moved.set_frame(joint.frame)
    spec.delete(joint)


def find_series_joint(spec: mujoco.MjSpec, joint: str, suffix: str) -> mujoco.MjsJoint | None:
    """Return the second joint with a suffix that is measured together with a joint; None if there is none."""
    sensor = spec.sensor(joint + POSITION)
    if sensor is None or sensor.type != mujoco.mjtSensor.mjSENS_TENDONPOS:
        return None
    parts = [wrap.target for wrap in spec.tendon(sensor.objname).path if wrap.type == mujoco.mjtWrap.mjWRAP_JOINT]
    pattern = re.escape(f"{joint}_{suffix}") + r"(_\d+)?"
    return next((part for part in parts if re.fullmatch(pattern, part.name)), None)


def compute_missing_armature(spec: mujoco.MjSpec, joint: str, wanted: float) -> float:
    """Return the armature that a second joint needs beside its link's inertia for a wanted inertia [kg·m²]."""
    model = spec.compile()
    dof = int(model.joint(joint).dofadr[0])
    return max(0.0, wanted - MIN_INERTIA_SHARE * float(model.dof_M0[dof] - model.dof_armature[dof]))


def ensure_measured_tendon(spec: mujoco.MjSpec, joint: str) -> mujoco.MjsTendon:
    """Return the fixed tendon that is measured as `<joint>.pos`.

    It is added if necessary, even beside a tendon of the model's author, which may exert forces.
    """
    sensor, name = spec.sensor(joint + POSITION), f"{joint}_link"
    parts = {joint: 1.0}
    if sensor is None:
        sensor = spec.add_sensor(name=joint + POSITION)
    elif sensor.type == mujoco.mjtSensor.mjSENS_JOINTPOS:
        parts = {sensor.objname: 1.0}
    elif sensor.objname.startswith(name):
        return spec.tendon(sensor.objname)
    else:
        parts = {wrap.target.name: wrap.coef for wrap in spec.tendon(sensor.objname).path}
    tendon = spec.add_tendon(name=make_unique_name(spec.tendon, name))
    clear_tendon(tendon)
    for part, share in parts.items():
        tendon.wrap_joint(part, share)
    sensor.type = mujoco.mjtSensor.mjSENS_TENDONPOS
    sensor.objtype = mujoco.mjtObj.mjOBJ_TENDON
    sensor.objname = tendon.name
    return tendon


def to_file_unit(spec: mujoco.MjSpec, joint: mujoco.MjsJoint, position: float) -> float:
    """Convert a joint's position [rad; m] to the unit of the model file; slides are always in metres."""
    is_angle = joint.type == mujoco.mjtJoint.mjJNT_HINGE
    return math.degrees(position) if is_angle and spec.compiler.degree else position
