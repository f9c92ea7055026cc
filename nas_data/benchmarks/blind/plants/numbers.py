"""The numbers of serial arms, in the groups in which they are needed; one row a joint, or its link, in SI units."""

from dataclasses import dataclass

import numpy as np


@dataclass
class Links:
    """Rigid links of n joints, each carried by the one before it; of many arms with a leading axis.

    Of a joint that slides, angles are lengths [m], speeds [m/s], torques forces [N], and inertias masses [kg].

    Attributes:
        offsets: Each joint in the frame of the link before it [m], shape (n, 3).
        sliding: Whether a joint slides along its axis rather than turning about it, shape (n,).
        turns: Each link's rotation in that frame at angle zero, shape (n, 3, 3).
        axes: Each joint's axis in its link's frame, shape (n, 3).
        masses: Of the links [kg], shape (n,).
        centres: Centres of mass in the links' frames [m], shape (n, 3).
        inertias: About the centres of mass, in the links' frames [kg m²], shape (n, 3, 3).
        gravity: In the base's frame [m/s²], shape (3,).
    """

    offsets: np.ndarray
    sliding: np.ndarray
    turns: np.ndarray
    axes: np.ndarray
    masses: np.ndarray
    centres: np.ndarray
    inertias: np.ndarray
    gravity: np.ndarray


@dataclass
class Servos:
    """What every model says of its drives.

    Attributes:
        damping: Joint damping [N m s/rad], shape (n,).
        armature: Reflected inertia [kg m²], shape (n,).
        friction: Coulomb friction [N m], shape (n,).
        gain: Servo's position gain [N m/rad], shape (n,); 0 for a motor.
        motor: Torque per command [N m], shape (n,): 1 for a motor, 0 for a position servo.
        servo_damping: Servo's own damping, within its saturation [N m s/rad], shape (n,).
        force: Lowest and highest torque of the servo [N m], shape (n, 2).
        control: Lowest and highest command [rad, N m], shape (n, 2).
    """

    damping: np.ndarray
    armature: np.ndarray
    friction: np.ndarray
    gain: np.ndarray
    motor: np.ndarray
    servo_damping: np.ndarray
    force: np.ndarray
    control: np.ndarray


@dataclass
class Hideable:
    """What may hide in a drive, and what only it needs; each of shape (n,).

    Attributes:
        viscous: Friction in proportion to speed [N m s/rad].
        stribeck: Break-away torque [N m] that falls to `kinetic_ratio` of it around `stribeck_velocity` [rad/s].
        load_ratio: Friction over the servo's torque.
        delay: Dead time of the commands [s].
        speed: Rate at which the servo's goal moves [rad/s].
        offset: Of the servo's rest from its command [rad].
        deadband: Error that the servo ignores [rad].
        play: Half width of the free play [rad].
        spring: Stiffness of the transmission [N m/rad]; infinite for a rigid one.
        flank: Stiffness of a gear's flank, where play ends [N m/rad].
        cogs: Amplitude of a torque [N m] that goes with the motor's angle, `cog_count` periods a turn.
        cable: Stiffness of a cable [N m/rad] that pulls towards `cable_angle` from the side `cable_side` of it.
    """

    viscous: np.ndarray
    stribeck: np.ndarray
    kinetic_ratio: np.ndarray
    stribeck_velocity: np.ndarray
    load_ratio: np.ndarray
    delay: np.ndarray
    speed: np.ndarray
    offset: np.ndarray
    deadband: np.ndarray
    play: np.ndarray
    spring: np.ndarray
    flank: np.ndarray
    cogs: np.ndarray
    cog_count: np.ndarray
    cog_phase: np.ndarray
    cable: np.ndarray
    cable_angle: np.ndarray
    cable_side: np.ndarray
