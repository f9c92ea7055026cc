"""Friction proportional to a servo's torque, in MJCF: the servo presses a pad against stops of the link."""

import mujoco
import numpy as np

from nas_data.effects.base import find_joint_actuator
from nas_data.effects.edits.pristine import clear_joint, clear_tendon
from nas_data.effects.edits.servo import has_torque_limit
from nas_data.errors import ModelFileError
from nas_data.mjcf.actuator_lookup import PAD, PARTS, PRESSED
from nas_data.mjcf.unique_name import make_unique_name

# Measured on servos of XL-320 size and on servos four times as fast (up to 22 rad/s), with a timestep of 0.5 ms and
# ratios of 0.1 to 0.6: deviation from the equation of at most 0.1° and 0.4°. Files for 0.5 ms deviate by at most 0.2°
# and 0.5° at 1 ms, and jam at 2 ms.
PER_TURN = 0.3  # [m/rad] coefficient of the pad in the servo's tendon: pad force over servo torque [1/m]
SMALLEST = 0.05  # smaller ratios use the clearance and mass of this ratio
DESIGN_SPEED_SHARE = 0.7  # share of the large speed for which the clearance is designed; faster motion hardly jams
# Clearance over the distance that the large torque moves the pad in a step. With less, the pad bounces between the
# stops; with more, it is late when the torque reverses.
LIGHT = 0.6
STOPS = 5.0  # radius of the stops and the pad over the clearance between them
SLIDING = 0.01  # sliding friction; without effect, because the contact is on the axis
CONTACT_SOLIMP = (0.999, 0.999, 0.001, 0.5, 2.0)  # solimp of the contact
TORSION = 4  # condim of a contact with torsional friction
HIDDEN_GROUP = 5  # geom group that viewers hide by default


def press_pad(spec: mujoco.MjSpec, joint: str, ratio: float, torque: float, speed: float) -> None:
    """Add friction of `ratio` times the servo's torque to a joint.

    Contact friction is MuJoCo's only friction that depends on a force. A pad `<joint>_pressed_pad` slides in the parent
    body along the joint's axis. The servo acts on a fixed tendon of the joint and the pad. Thus it presses the pad, in
    proportion to its torque, against one of two stops on the link. The contact is on the axis and has torsional
    friction. Load and friction are solved in the same step, without delay.

    A clearance between pad and stops is necessary, because MuJoCo's friction pushes a turning stop away from the pad.
    The resulting position error is below the resolution of sensors.

    Args:
        spec: Model.
        joint: A hinge that is the only joint of its body.
        ratio: Friction torque over the servo's torque.
        torque: Large torque of the servo [N·m], for which the pad is designed.
        speed: Large speed of the joint [rad/s], for which the pad is designed.

    Raises:
        ModelFileError: the joint is no such hinge, or has a pad already.
    """
    refuse_joint(spec, joint)
    step, share = spec.option.timestep, max(ratio, SMALLEST)
    clearance = 2 * DESIGN_SPEED_SHARE * share * speed * step / PER_TURN
    mass = LIGHT * PER_TURN * torque * step**2 / clearance
    enable_contacts(spec)
    pad, stops = add_parts(spec, joint, mass, clearance)
    couple_servo(spec, joint)
    for stop in stops:
        pair = spec.add_pair(name=make_unique_name(spec.pair, stop), geomname1=pad, geomname2=stop)
        pair.condim, pair.friction = TORSION, [SLIDING, SLIDING, ratio / PER_TURN, 0.0, 0.0]
        pair.margin, pair.gap, pair.solimp = 0.0, 0.0, CONTACT_SOLIMP
        pair.solref = [2 * step, 1.0]  # a stiffer or less damped contact bounces, and then the joint creeps
        pair.solreffriction = [0.0, 0.0]  # zero means: as in normal direction


def refuse_joint(spec: mujoco.MjSpec, joint: str) -> None:
    """Refuse a joint that is no hinge, shares its body with another joint, or has a pad.

    Raises:
        ModelFileError: says which.
    """
    hinge = spec.joint(joint)
    if hinge.type != mujoco.mjtJoint.mjJNT_HINGE or len(hinge.parent.joints) > 1:
        raise ModelFileError(
            f"load_friction cannot be added to the joint '{joint}': it must be a hinge and the only joint of its body."
        )
    if spec.joint(joint + PAD) is not None:
        raise ModelFileError(f"The joint '{joint}' has load friction in its model already.")


def enable_contacts(spec: mujoco.MjSpec) -> None:
    """Enable contacts in a model that disables them, without enabling the model's own contacts."""
    disabled = int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    if not spec.option.disableflags & disabled:
        return
    spec.option.disableflags &= ~disabled
    for geom in spec.geoms:
        geom.contype = geom.conaffinity = 0
    for pair in list(spec.pairs):
        spec.delete(pair)


def add_parts(spec: mujoco.MjSpec, joint: str, mass: float, clearance: float) -> tuple[str, tuple[str, str]]:
    """Add pad (mass in kg) and stops (clearance in m) on a joint's axis; return the names of their geoms."""
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    index, body = int(model.joint(joint).id), spec.joint(joint).parent
    link = int(model.jnt_bodyid[index])
    base = int(model.body_parentid[link])
    anchor, axis = data.xanchor[index], data.xaxis[index]
    radius = STOPS * clearance
    holder = (spec.worldbody if base == 0 else body.parent).add_body(
        name=make_unique_name(spec.body, joint + "_pad"), explicitinertial=True, mass=mass, gravcomp=1.0
    )
    holder.pos, holder.ipos = to_body_frame(data, base, anchor), np.zeros(3)
    holder.inertia = np.full(3, 0.4 * mass * radius**2)
    slide = holder.add_joint(name=joint + PAD, type=mujoco.mjtJoint.mjJNT_SLIDE)
    clear_joint(slide)
    slide.pos, slide.axis = np.zeros(3), data.xmat[base].reshape(3, 3).T @ axis
    pad = add_ball(spec, holder, joint + "_pad", np.zeros(3), radius)
    ends = [to_body_frame(data, link, anchor + side * (2 * radius + clearance) * axis) for side in (-1.0, 1.0)]
    stops = [add_ball(spec, body, joint + "_stop", end, radius) for end in ends]
    return pad, (stops[0], stops[1])


def to_body_frame(data: mujoco.MjData, body: int, point: np.ndarray) -> np.ndarray:
    """Transform a point [m] from world to body coordinates, shape (3,)."""
    return np.asarray(data.xmat[body].reshape(3, 3).T @ (point - data.xpos[body]))


def add_ball(spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str, position: np.ndarray, radius: float) -> str:
    """Add a massless, invisible sphere that only collides in explicit pairs; return its name."""
    ball = body.add_geom(name=make_unique_name(spec.geom, name), type=mujoco.mjtGeom.mjGEOM_SPHERE)
    ball.size, ball.pos, ball.quat = [radius, 0.0, 0.0], position, [1.0, 0.0, 0.0, 0.0]
    ball.mass, ball.contype, ball.conaffinity = 0.0, 0, 0
    ball.group, ball.rgba, ball.material = HIDDEN_GROUP, np.zeros(4), ""
    return str(ball.name)


def couple_servo(spec: mujoco.MjSpec, joint: str) -> None:
    """Let the actuators of the joint's servo also act on the pad, in proportion to their torque on the joint."""
    slide, limited = spec.joint(joint + PAD), spec.joint(joint)
    if has_torque_limit(limited):
        slide.actfrclimited, slide.actfrcrange = limited.actfrclimited, PER_TURN * limited.actfrcrange
    tendons = set()
    parts = [spec.actuator(joint + part) for part in PARTS]
    for servo in (find_joint_actuator(spec, joint), *(part for part in parts if part is not None)):
        if servo.trntype == mujoco.mjtTrn.mjTRN_JOINT:
            tendon = spec.tendon(joint + PRESSED) or spec.add_tendon(name=joint + PRESSED)
            if not tendon.path:
                clear_tendon(tendon)
                tendon.wrap_joint(joint, 1.0)
            servo.trntype, servo.target = mujoco.mjtTrn.mjTRN_TENDON, tendon.name
        tendons.add(servo.target)
    for name in sorted(tendons):
        tendon = spec.tendon(name)
        coefficient = sum(wrap.coef for wrap in tendon.path if wrap.target.name == joint)
        tendon.wrap_joint(slide.name, PER_TURN * coefficient)
