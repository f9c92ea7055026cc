"""Constants of a serial arm in SI units, one row per joint or link, read from its nominal model."""

from dataclasses import dataclass

import mujoco
import numpy as np

from nas_data.benchmarks.blind.plants.vectors import convert_quaternion
from nas_data.errors import ModelFileError


@dataclass
class Links:
    """Rigid links of n joints, each carried by the one before it; batches of arms add a leading axis.

    For a sliding joint, angles are lengths [m], speeds [m/s], torques forces [N], and inertias masses [kg].
    """

    offsets: np.ndarray  # each joint in the parent link's frame [m], shape (n, 3)
    sliding: np.ndarray  # whether a joint slides along its axis, shape (n,)
    turns: np.ndarray  # each link's rotation in that frame at angle zero, shape (n, 3, 3)
    axes: np.ndarray  # each joint's axis in its link's frame, shape (n, 3)
    masses: np.ndarray  # of the links [kg], shape (n,)
    centres: np.ndarray  # centres of mass in the links' frames [m], shape (n, 3)
    inertias: np.ndarray  # about the centres of mass, in the links' frames [kg m²], shape (n, 3, 3)
    gravity: np.ndarray  # in the base's frame [m/s²], shape (3,)


@dataclass
class Servos:
    """Drive parameters that every nominal model has."""

    damping: np.ndarray  # joint damping [N m s/rad], shape (n,)
    armature: np.ndarray  # reflected inertia [kg m²], shape (n,)
    friction: np.ndarray  # Coulomb friction [N m], shape (n,)
    gain: np.ndarray  # Servo's position gain [N m/rad], shape (n,); 0 for a motor
    motor: np.ndarray  # torque per command [N m], shape (n,): 1 for a motor, 0 for a position servo
    servo_damping: np.ndarray  # Servo's own damping, within its saturation [N m s/rad], shape (n,)
    force: np.ndarray  # lowest and highest torque of the servo [N m], shape (n, 2)
    control: np.ndarray  # lowest and highest command [rad, N m], shape (n, 2)


@dataclass
class Hideable:
    """Drive parameters of hidden effects; shape (n,) each."""

    viscous: np.ndarray  # friction in proportion to speed [N m s/rad]
    # Break-away torque [N m] that falls to `kinetic_ratio` of it around `stribeck_velocity` [rad/s]
    stribeck: np.ndarray
    kinetic_ratio: np.ndarray
    stribeck_velocity: np.ndarray
    load_ratio: np.ndarray  # friction over the servo's torque
    delay: np.ndarray  # dead time of the commands [s]
    speed: np.ndarray  # rate at which the servo's goal moves [rad/s]
    offset: np.ndarray  # offset of the servo's equilibrium from its command [rad]
    deadband: np.ndarray  # error that the servo ignores [rad]
    play: np.ndarray  # half width of the free play [rad]
    spring: np.ndarray  # stiffness of the transmission [N m/rad]; infinite for a rigid one
    flank: np.ndarray  # stiffness of a gear's flank, where the play ends [N m/rad]
    stall: np.ndarray  # torque limit at rest of a motor at a limited voltage [N m], both directions
    back_emf: np.ndarray  # how much that limit falls with speed [N m s/rad]
    acceleration: np.ndarray  # rate at which the speed of the servo's goal changes [rad/s²]
    punch: np.ndarray  # least torque that the servo gives once its position is off the goal [N m]
    integral: np.ndarray  # gain of the integral of the servo's error [N m/(rad s)]
    uneven: np.ndarray  # friction in the positive direction less that in the negative one, halved [N m]
    cogs: np.ndarray  # amplitude of a torque [N m] periodic in the motor's angle, `cog_count` periods per turn
    cog_count: np.ndarray
    cog_phase: np.ndarray
    # stiffness of a cable [N m/rad] that pulls towards `cable_angle` when the joint is on its side `cable_side`
    cable: np.ndarray
    cable_angle: np.ndarray
    cable_side: np.ndarray
    # eccentric gear: amplitude [rad] by which the joint leads its servo; `eccentric_count` periods per turn
    eccentric: np.ndarray
    eccentric_count: np.ndarray
    eccentric_phase: np.ndarray
    coupling: np.ndarray  # angle by which the joint turns, relative to its servo, per angle of the joint before it
    heat_rise: np.ndarray  # warmth that a lasting largest torque ends at; a warmth of 1 halves the torque
    heat_time: np.ndarray  # time constant of the warmth [s]
    sag: np.ndarray  # relative loss of supply voltage per torque of the other joints [1/(N m)]


@dataclass
class Constants(Servos, Links):
    """A serial arm of n hinges and slides, each with a position servo or a motor."""

    joints: tuple[str, ...]  # names, from the base on

    @classmethod
    def of(cls, model: mujoco.MjModel) -> "Constants":
        """Read a compiled model.

        Raises:
            ModelFileError: it is no plain serial arm of hinges and slides with one position servo or motor each.
        """
        bodies = find_serial_bodies(model)
        turned = [convert_quaternion(model.body_iquat[body]) for body in bodies]
        inertias = [
            turn @ np.diag(model.body_inertia[body]) @ turn.T for turn, body in zip(turned, bodies, strict=True)
        ]
        servos = np.array([find_servo(model, joint) for joint in range(model.njnt)])
        force, control = model.actuator_forcerange[servos].copy(), model.actuator_ctrlrange[servos].copy()
        force[model.actuator_forcelimited[servos] == 0] = (-np.inf, np.inf)
        control[model.actuator_ctrllimited[servos] == 0] = (-np.inf, np.inf)
        return cls(
            joints=tuple(model.joint(joint).name for joint in range(model.njnt)),
            offsets=model.body_pos[bodies].copy(),
            sliding=model.jnt_type == int(mujoco.mjtJoint.mjJNT_SLIDE),
            turns=np.stack([convert_quaternion(model.body_quat[body]) for body in bodies]),
            axes=model.jnt_axis.copy(),
            masses=model.body_mass[bodies].copy(),
            centres=model.body_ipos[bodies].copy(),
            inertias=np.stack(inertias),
            gravity=model.opt.gravity.copy(),
            damping=select_linear_coefficients(model.dof_damping, model.nv),
            armature=model.dof_armature.copy(),
            friction=model.dof_frictionloss.copy(),
            gain=-model.actuator_biasprm[servos, 1],
            motor=np.where(model.actuator_biasprm[servos, 1] == 0, model.actuator_gainprm[servos, 0], 0.0),
            servo_damping=-model.actuator_biasprm[servos, 2],
            force=force,
            control=control,
        )


def select_linear_coefficients(values: np.ndarray, count: int) -> np.ndarray:
    """Return each degree of freedom's linear coefficient; the model may hold polynomials."""
    return np.asarray(values, float).reshape(count, -1)[:, 0].copy()


def find_serial_bodies(model: mujoco.MjModel) -> list[int]:
    """Return the bodies of a serial chain from the base on.

    Raises:
        ModelFileError: the moving bodies are no chain of one joint each, or the base is not at the origin.
    """
    bodies = [body for body in range(1, model.nbody) if model.body_jntnum[body]]
    for before, body in zip([None, *bodies[:-1]], bodies, strict=True):
        parent = int(model.body_parentid[body])
        rooted = before is None and not model.body_weldid[parent] and not model.body_pos[parent].any()
        if (parent != before and not rooted) or model.body_jntnum[body] != 1:
            raise ModelFileError("A plant is a serial chain of bodies with one joint each, on a base at the origin.")
    kinds = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
    if not np.isin(model.jnt_type, kinds).all() or model.jnt_pos.any():
        raise ModelFileError("A plant has hinges and slides at the origins of their bodies, and no other joints.")
    return bodies


def find_servo(model: mujoco.MjModel, joint: int) -> int:
    """Return the position servo or motor of a joint.

    Raises:
        ModelFileError: there is not exactly one.
    """
    drives = (model.actuator_trntype == int(mujoco.mjtTrn.mjTRN_JOINT)) & (model.actuator_trnid[:, 0] == joint)
    found = np.flatnonzero(drives)
    if len(found) != 1 or model.actuator_biasprm[found[0], 1] > 0:
        raise ModelFileError(f"The joint '{model.joint(joint).name}' of a plant needs exactly one servo or motor.")
    return int(found[0])
