"""Drives of servos that move a joint and its followers through a fixed tendon, as a parallel gripper's does."""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from nas_data.mjcf.actuator_lookup import SHARED, find_driven_joint

LARGEST_OFFSET = 1e-9  # [m or rad] length of a tendon that counts as zero where its joint is at zero
PASSIVE = ("stiffness", "damping", "springlength", "frictionloss", "armature")  # a tendon's own forces


@dataclass(frozen=True)
class SharedDrive:
    """A servo's fixed tendon over one joint and its linear followers: L = Σ cᵢ qᵢ, with qᵢ = sᵢ q for each follower.

    Attributes:
        actuator: Index of the actuator.
        joint: Name of the joint: the first of the tendon.
        leverage: Length of the tendon per position of the joint, Σ cᵢ sᵢ.
        parts: Names of all joints of the tendon, and their coefficients cᵢ.
    """

    actuator: int
    joint: str
    leverage: float
    parts: tuple[tuple[str, float], ...]


def find_shared_drives(spec: mujoco.MjSpec) -> list[SharedDrive]:
    """Return the actuators that command one joint through a fixed tendon.

    No other actuator with a control may move the joints of the tendon. A tendon is left alone if it or one of its
    joints limits the actuators' force: that limit would not be the servo's.
    """
    actuators = [
        (index, actuator)
        for index, actuator in enumerate(spec.actuators)
        if actuator.ctrlspec != int(mujoco.mjtCtrlInput.mjINPUT_NONE)
    ]
    driven = [joint for _, actuator in actuators if (joint := find_driven_joint(spec, actuator))]
    indirect = [
        (index, actuator.target)
        for index, actuator in actuators
        if actuator.trntype == mujoco.mjtTrn.mjTRN_TENDON and not find_driven_joint(spec, actuator)
    ]
    if not indirect:
        return []
    model = spec.copy().compile()
    wrapped = {target: list_tendon_joints(model, int(model.tendon(target).id)) for _, target in indirect}
    driven += [model.joint(joint).name for _, target in indirect for joint, _ in wrapped[target]]
    found = [
        make_shared_drive(model, index, wrapped[target])
        for index, target in indirect
        if not model.tendon_actfrclimited[model.tendon(target).id]
    ]
    return [drive for drive in found if drive and all(driven.count(joint) == 1 for joint, _ in drive.parts)]


def add_shared_drives(spec: mujoco.MjSpec) -> None:
    """Let servos with a shared drive act through a tendon `<joint>_shared_drive`, whose length is the joint's position.

    All coefficients are divided by the leverage, by which the gear is multiplied: forces stay the same. The first
    tendon keeps its own springs, friction and limits.
    """
    model, drives = spec.copy().compile(), find_shared_drives(spec)
    for drive in drives:
        tendon = spec.add_tendon(name=drive.joint + SHARED)
        pristine = mujoco.MjSpec().add_tendon()  # without the model's default classes
        for field in PASSIVE:
            setattr(tendon, field, getattr(pristine, field))
        tendon.limited = tendon.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE
        for joint, coefficient in drive.parts:
            tendon.wrap_joint(joint, coefficient / drive.leverage)
        actuator = spec.actuators[drive.actuator]
        gear = actuator.gear.copy()
        gear[0] *= drive.leverage
        actuator.gear, actuator.target = gear, tendon.name
        # what the compiler derives from the transmission: velocity feedback from a damping ratio, and ranges
        actuator.biasprm = model.actuator_biasprm[drive.actuator]
        if actuator.inheritrange:
            actuator.ctrlrange = model.actuator_ctrlrange[model.actuator_ctrladr[drive.actuator]]
            actuator.actrange, actuator.inheritrange = model.actuator_actrange[drive.actuator], 0.0


def make_shared_drive(model: mujoco.MjModel, actuator: int, parts: Sequence[tuple[int, float]]) -> SharedDrive | None:
    """Return the drive of an actuator; None if its joints are no linear followers of the first.

    Args:
        model: Compiled model.
        actuator: Index of the actuator.
        parts: Joints of its tendon, by index, and their coefficients.
    """
    lead = parts[0][0] if parts else -1
    slopes = find_linear_followers(model, lead)
    if not parts or not all(joint in slopes and not model.jnt_actfrclimited[joint] for joint, _ in parts):
        return None
    zero = {joint: float(model.qpos0[model.jnt_qposadr[joint]]) for joint in slopes}
    leverage = sum(share * slopes[joint] for joint, share in parts)
    offset = sum(share * (zero[joint] - slopes[joint] * zero[lead]) for joint, share in parts)
    names = tuple((str(model.joint(joint).name), share) for joint, share in parts)
    taken = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_TENDON, names[0][0] + SHARED) >= 0
    if not leverage or abs(offset) > LARGEST_OFFSET or taken or not all(name for name, _ in names):
        return None
    return SharedDrive(actuator, names[0][0], leverage, names)


def list_tendon_joints(model: mujoco.MjModel, tendon: int) -> list[tuple[int, float]]:
    """Return the joints of a fixed tendon, by index, and their coefficients; empty for a spatial tendon."""
    wraps = range(model.tendon_adr[tendon], model.tendon_adr[tendon] + model.tendon_num[tendon])
    if any(model.wrap_type[wrap] != int(mujoco.mjtWrap.mjWRAP_JOINT) for wrap in wraps):
        return []
    return [(int(model.wrap_objid[wrap]), float(model.wrap_prm[wrap])) for wrap in wraps]


def find_linear_followers(model: mujoco.MjModel, joint: int) -> dict[int, float]:
    """Return the joints that active equalities tie linearly to a joint, and how far each moves per movement of it.

    The joint itself is among them. An equality ties its first joint to its second; each may be the given one.
    """
    slopes = {joint: 1.0}
    if model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_EQUALITY):
        return slopes
    ties = (model.eq_type == int(mujoco.mjtEq.mjEQ_JOINT)) & model.eq_active0.astype(bool) & (model.eq_obj2id >= 0)
    linear = ties & (model.eq_data[:, 0] == 0) & (model.eq_data[:, 1] != 0) & ~model.eq_data[:, 2:5].any(axis=1)
    for _ in range(int(linear.sum())):
        for equality in np.flatnonzero(linear).tolist():
            first, second = int(model.eq_obj1id[equality]), int(model.eq_obj2id[equality])
            ratio = float(model.eq_data[equality, 1])
            if second in slopes:
                slopes.setdefault(first, ratio * slopes[second])
            elif first in slopes:
                slopes[second] = slopes[first] / ratio
    return slopes
