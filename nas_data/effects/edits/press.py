"""Friction in proportion to what a servo gives, in MJCF: a pad that the servo presses between two stops of the link."""

import mujoco
import numpy as np

from nas_data.effects.base import joint_actuator
from nas_data.effects.edits.pristine import clear_joint, clear_tendon
from nas_data.errors import ModelFileError
from nas_data.mjcf.actuator_lookup import PAD, PARTS, PRESSED
from nas_data.mjcf.unique_name import free_name

# Tried on servos of XL-320 size and on ones four times as quick (up to 22 rad/s), at a step of 0.5 ms and ratios of 0.1
# to 0.6: within 0.1° and 0.4° of the equation. Files made for 0.5 ms are within 0.2° and 0.5° at 1 ms and jam at 2 ms.
PER_TURN = 0.3  # [m/rad] of the pad's way that the servo takes for an angle: the pad's force per torque [1/m]
SMALLEST = 0.05  # ratio below which clearance and mass are no longer made to measure
QUICK = 0.7  # of the large speed, for which clearance is left: at more, stops still hardly jam
# Clearance over the way that the large torque moves the pad in a step: with less, stops throw it to and fro; with more,
# it is late where the torque reverses.
LIGHT = 0.6
STOPS = 5.0  # radius of the stops and the pad over the clearance between them
SLIDING = 0.01  # sliding friction, of which there is none: the contact lies on the axis
HARD = (0.999, 0.999, 0.001, 0.5, 2.0)  # impedance of the contact
TORSION = 4  # dimensions of a contact with friction about its normal
HIDDEN = 5  # group of geoms that viewers leave out unless asked


def press_pad(spec: mujoco.MjSpec, joint: str, ratio: float, torque: float, speed: float) -> None:
    """Let a servo rub its joint with `ratio` times the torque that it gives.

    The engine knows one friction that follows a force: that of contacts. A pad `<joint>_pressed_pad` slides in the
    parent body along the joint's axis. The servo pulls at the joint by a fixed tendon that has a little of the pad in
    it, so that it presses the pad, in proportion to its torque, against one of two stops that turn with the link; the
    contact lies on the axis and rubs about it. Nothing lags: load and friction are found together in every step.

    A turning stop is driven away from the pad by the engine's friction, which has no gap of its own; so stops leave a
    clearance, by which servo and pad together are off by less than a sensor sees.

    Args:
        spec: Model.
        joint: A hinge alone on its body.
        ratio: Friction over the servo's torque.
        torque: Large torque of the servo [N·m], for which the pad is made.
        speed: Large speed of the joint [rad/s], likewise.

    Raises:
        ModelFileError: the joint is another, or has such a pad already.
    """
    refuse(spec, joint)
    step, share = spec.option.timestep, max(ratio, SMALLEST)
    clearance = 2 * QUICK * share * speed * step / PER_TURN
    mass = LIGHT * PER_TURN * torque * step**2 / clearance
    enable_contacts(spec)
    pad, stops = add_parts(spec, joint, mass, clearance)
    couple(spec, joint)
    for stop in stops:
        pair = spec.add_pair(name=free_name(spec.pair, stop), geomname1=pad, geomname2=stop)
        pair.condim, pair.friction = TORSION, [SLIDING, SLIDING, ratio / PER_TURN, 0.0, 0.0]
        pair.margin, pair.gap, pair.solimp = 0.0, 0.0, HARD
        pair.solref = [2 * step, 1.0]  # quicker or less damped it bounces, and a bouncing pad lets the joint creep
        pair.solreffriction = [0.0, 0.0]  # as the contact's


def refuse(spec: mujoco.MjSpec, joint: str) -> None:
    """Refuse a joint in which a pad would rub something else than the servo does, or twice."""
    hinge = spec.joint(joint)
    if hinge.type != mujoco.mjtJoint.mjJNT_HINGE or len(hinge.parent.joints) > 1:
        raise ModelFileError(
            f"Friction under load cannot be written for the joint '{joint}': only for a hinge alone on its body."
        )
    if spec.joint(joint + PAD) is not None:
        raise ModelFileError(f"The joint '{joint}' has friction under load in its model already.")


def enable_contacts(spec: mujoco.MjSpec) -> None:
    """Let contacts act in a model that disabled them, but none of its own."""
    disabled = int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    if not spec.option.disableflags & disabled:
        return
    spec.option.disableflags &= ~disabled
    for geom in spec.geoms:
        geom.contype = geom.conaffinity = 0
    for pair in list(spec.pairs):
        spec.delete(pair)


def add_parts(spec: mujoco.MjSpec, joint: str, mass: float, clearance: float) -> tuple[str, tuple[str, str]]:
    """Add pad and stops on a joint's axis; return the names of their geoms."""
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    index, body = int(model.joint(joint).id), spec.joint(joint).parent
    link = int(model.jnt_bodyid[index])
    base = int(model.body_parentid[link])
    anchor, axis = data.xanchor[index], data.xaxis[index]
    radius = STOPS * clearance
    holder = (spec.worldbody if base == 0 else body.parent).add_body(
        name=free_name(spec.body, joint + "_pad"), explicitinertial=True, mass=mass, gravcomp=1.0
    )
    holder.pos, holder.ipos = inside(data, base, anchor), np.zeros(3)
    holder.inertia = np.full(3, 0.4 * mass * radius**2)
    slide = holder.add_joint(name=joint + PAD, type=mujoco.mjtJoint.mjJNT_SLIDE)
    clear_joint(slide)
    slide.pos, slide.axis = np.zeros(3), data.xmat[base].reshape(3, 3).T @ axis
    pad = add_ball(spec, holder, joint + "_pad", np.zeros(3), radius)
    ends = [inside(data, link, anchor + side * (2 * radius + clearance) * axis) for side in (-1.0, 1.0)]
    stops = [add_ball(spec, body, joint + "_stop", end, radius) for end in ends]
    return pad, (stops[0], stops[1])


def inside(data: mujoco.MjData, body: int, point: np.ndarray) -> np.ndarray:
    """Return a point of the world in a body's frame, shape (3,)."""
    return np.asarray(data.xmat[body].reshape(3, 3).T @ (point - data.xpos[body]))


def add_ball(spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str, place: np.ndarray, radius: float) -> str:
    """Add a weightless ball that touches nothing but what a pair says, and that nobody sees; return its name."""
    ball = body.add_geom(name=free_name(spec.geom, name), type=mujoco.mjtGeom.mjGEOM_SPHERE)
    ball.size, ball.pos, ball.quat = [radius, 0.0, 0.0], place, [1.0, 0.0, 0.0, 0.0]
    ball.mass, ball.contype, ball.conaffinity = 0.0, 0, 0
    ball.group, ball.rgba, ball.material = HIDDEN, np.zeros(4), ""
    return str(ball.name)


def couple(spec: mujoco.MjSpec, joint: str) -> None:
    """Let every actuator that is the joint's servo act on the pad in proportion to what it gives the joint."""
    slide, limited = spec.joint(joint + PAD), spec.joint(joint)
    if limited.actfrclimited != mujoco.mjtLimited.mjLIMITED_FALSE and np.any(limited.actfrcrange):
        slide.actfrclimited, slide.actfrcrange = limited.actfrclimited, PER_TURN * limited.actfrcrange
    tendons = set()
    parts = [spec.actuator(joint + part) for part in PARTS]
    for servo in (joint_actuator(spec, joint), *(part for part in parts if part is not None)):
        if servo.trntype == mujoco.mjtTrn.mjTRN_JOINT:
            tendon = spec.tendon(joint + PRESSED) or spec.add_tendon(name=joint + PRESSED)
            if not tendon.path:
                clear_tendon(tendon)
                tendon.wrap_joint(joint, 1.0)
            servo.trntype, servo.target = mujoco.mjtTrn.mjTRN_TENDON, tendon.name
        tendons.add(servo.target)
    for name in sorted(tendons):
        tendon = spec.tendon(name)
        own = sum(wrap.coef for wrap in tendon.path if wrap.target.name == joint)
        tendon.wrap_joint(slide.name, PER_TURN * own)
