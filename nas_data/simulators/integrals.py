"""Integral parts of position servos: those of an arm at rest hold its load."""

from dataclasses import dataclass

import mujoco
import numpy as np

from nas_data.simulators.followers import Followers
from nas_data.simulators.layout import Layout

HELD_SECONDS = 10.0  # [s] for which an arm at rest has held its posture


@dataclass(frozen=True)
class Integrals:
    """Integral parts (`ki`) of the servos of k measured joints.

    Attributes:
        joints: Index of each joint among the measured ones, shape (k,).
        addresses: Index of each integral in `act`, shape (k,).
        gain: Torque per integral [N m; N per rad s; m s], shape (k,).
        constant: Torque of each servo without error and integral [N m; N], shape (k,).
        share: Share of its load that each integral holds after `HELD_SECONDS`, shape (k,).
        most: Largest integral, shape (k,).
    """

    joints: np.ndarray
    addresses: np.ndarray
    gain: np.ndarray
    constant: np.ndarray
    share: np.ndarray
    most: np.ndarray

    @classmethod
    def of(cls, model: mujoco.MjModel, layout: Layout) -> "Integrals":
        """Find the integral parts of a model's measured joints."""
        actuators = layout.inputs.actuators.astype(int)
        integrating = (model.actuator_gaintype == int(mujoco.mjtGain.mjGAIN_PID)) & (model.actuator_gainprm[:, 0] != 0)
        joints = np.flatnonzero(integrating[actuators])
        owners = actuators[joints]
        gear, limits = model.actuator_gear[owners, 0], model.actuator_dynprm[owners, 0]
        gain, stiffness = model.actuator_gainprm[owners, 0], -model.actuator_biasprm[owners, 1]
        return cls(
            joints=joints,
            addresses=model.actuator_actadr[owners] + model.actuator_actnum[owners] - 1,  # the last of [slew, integral]
            gain=gain * gear,
            constant=model.actuator_biasprm[owners, 0] * gear,
            # the error e of a servo that stands still: kp · e + ki · ∫ e dt = load, so e decays at the rate ki / kp
            share=1 - np.exp(-HELD_SECONDS * gain / np.maximum(stiffness, 1e-12)),
            most=np.where(limits > 0, limits, np.inf),
        )

    def __bool__(self) -> bool:
        """Whether there are any."""
        return bool(len(self.joints))

    def compute_held(self, loads: np.ndarray) -> np.ndarray:
        """Return the integrals, shape (k,), that hold the loads of all measured joints [N m; N], shape (n,)."""
        return np.clip(self.share * (loads[self.joints] - self.constant) / self.gain, -self.most, self.most)


def compute_weight(
    model: mujoco.MjModel, data: mujoco.MjData, qpos: np.ndarray, followers: Followers | None
) -> np.ndarray:
    """Return the gravity torques that the servos of an arm at rest hold [N m; N], shape (N, nv).

    Gravity compensation carries its part, and constraints transmit the weight of followers to the measured joints:
    with the gravity torques g, the servos hold g + (∂q̇_f/∂q̇)ᵀ g_f.

    Args:
        model: Compiled model.
        data: Scratch data with velocities of zero.
        qpos: Positions with the followers in place, shape (N, nq).
        followers: Joints that constraints tie to the measured ones; None if there are none.
    """
    weight = np.empty((len(qpos), model.nv))
    for row, positions in zip(weight, qpos, strict=True):
        data.qpos[:] = positions
        mujoco.mj_forward(model, data)
        row[:] = data.qfrc_bias - data.qfrc_gravcomp
    if followers is not None:
        carried = followers.velocity_jacobian(qpos).transpose(0, 2, 1) @ weight[:, followers.dofs, None]
        weight += carried[..., 0]
    return weight
