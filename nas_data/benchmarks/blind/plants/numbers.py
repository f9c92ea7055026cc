"""The numbers of serial arms, in the groups in which they are needed; one row a joint, or its link, in SI units."""

from dataclasses import dataclass

import numpy as np


@dataclass
class Links:
    """Rigid links of n joints, each carried by the one before it; of many arms with a leading axis.

    Of a joint that slides, angles are lengths [m], speeds [m/s], torques forces [N], and inertias masses [kg].
    """

    offsets: np.ndarray  # each joint in the frame of the link before it [m], shape (n, 3)
    sliding: np.ndarray  # whether a joint slides along its axis rather than turning about it, shape (n,)
    turns: np.ndarray  # each link's rotation in that frame at angle zero, shape (n, 3, 3)
    axes: np.ndarray  # each joint's axis in its link's frame, shape (n, 3)
    masses: np.ndarray  # of the links [kg], shape (n,)
    centres: np.ndarray  # centres of mass in the links' frames [m], shape (n, 3)
    inertias: np.ndarray  # about the centres of mass, in the links' frames [kg m²], shape (n, 3, 3)
    gravity: np.ndarray  # in the base's frame [m/s²], shape (3,)


@dataclass
class Servos:
    """What every model says of its drives."""

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
    """What may hide in a drive, and what only it needs; each of shape (n,)."""

    viscous: np.ndarray  # friction in proportion to speed [N m s/rad]
    # Break-away torque [N m] that falls to `kinetic_ratio` of it around `stribeck_velocity` [rad/s]
    stribeck: np.ndarray
    kinetic_ratio: np.ndarray
    stribeck_velocity: np.ndarray
    load_ratio: np.ndarray  # friction over the servo's torque
    delay: np.ndarray  # dead time of the commands [s]
    speed: np.ndarray  # rate at which the servo's goal moves [rad/s]
    offset: np.ndarray  # of the servo's rest from its command [rad]
    deadband: np.ndarray  # error that the servo ignores [rad]
    play: np.ndarray  # half width of the free play [rad]
    spring: np.ndarray  # stiffness of the transmission [N m/rad]; infinite for a rigid one
    flank: np.ndarray  # stiffness of a gear's flank, where play ends [N m/rad]
    cogs: np.ndarray  # amplitude of a torque [N m] that goes with the motor's angle, `cog_count` periods a turn
    cog_count: np.ndarray
    cog_phase: np.ndarray
    # stiffness of a cable [N m/rad] that pulls towards `cable_angle` from the side `cable_side` of it
    cable: np.ndarray
    cable_angle: np.ndarray
    cable_side: np.ndarray
