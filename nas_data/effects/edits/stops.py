"""Stops of a joint's range, rigid or yielding in proportion to their load."""

import math

import mujoco
import numpy as np

HARD_STOP = (0.99, 0.999, 0.001, 0.5, 2.0)  # solimp: the servo's torque deforms the stop by less than 1e-4 rad
LOSS_TIME = 1e-3  # [s] damping over stiffness of a yielding stop, as of `joint_compliance`
RESOLVED = 0.5  # impedance below which the timestep resolves the oscillation on a stop
SOFTEST, HARDEST = 2e-4, 0.99  # impedances of yielding stops; MuJoCo needs 1e-4


def soften_stops(spec: mujoco.MjSpec, joint: mujoco.MjsJoint, stiffness: float) -> None:
    """Give the stops of a joint a stiffness [N·m/rad], in series with that of stops that yield already.

    A limit is a spring of −solref₀ / ((1 − d) · w), with its impedance d and the joint's inverse inertia w at the
    reference posture. It has a virtual mass of d / ((1 − d) · w), which is chosen as (2 · timestep)² · stiffness:
    hardly any for a soft stop, and as much as the timestep needs for a hard one.

    Source: MuJoCo documentation, Computation, Solver parameters: f = (aref − a) / R, R = (1 − d) / d · w.
    """
    model = spec.compile()
    index = int(model.joint(joint.name).id)
    weight = float(model.dof_invweight0[model.jnt_dofadr[index]])
    total = 1 / (1 / stiffness + 1 / compute_stop_stiffness(model, index))
    mass = (2 * spec.option.timestep) ** 2 * total * weight
    if mass / (1 + mass) >= HARDEST:
        return  # harder than the rigid stop
    impedance = max(mass / (1 + mass), SOFTEST)
    joint.solimp_limit = [impedance, impedance, *HARD_STOP[2:]]
    joint.solref_limit = -total * (1 - impedance) * weight * np.array([1.0, LOSS_TIME])


def compute_stop_stiffness(model: mujoco.MjModel, joint: int) -> float:
    """Return the stiffness of a joint's stops [N·m/rad]; infinite if they are rigid."""
    if model.jnt_solref[joint, 0] >= 0:
        return math.inf
    weight = float(model.dof_invweight0[model.jnt_dofadr[joint]])
    return -float(model.jnt_solref[joint, 0]) / ((1 - float(model.jnt_solimp[joint, 0])) * weight)


class YieldingStops:
    """Stops as springs, for an engine that has rigid ones only; stops too stiff for the timestep are left to it."""

    def __init__(self, model: mujoco.MjModel) -> None:
        """Find the stops of a compiled model."""
        self.joints = find_yielding_stops(model)
        self.qpos, self.dof = model.jnt_qposadr[self.joints], model.jnt_dofadr[self.joints]
        self.low, self.high = model.jnt_range[self.joints].T
        self.stiffness = np.array([compute_stop_stiffness(model, joint) for joint in self.joints])
        stiffness, damping = model.jnt_solref[self.joints].T
        self.loss_time = damping / stiffness

    def compute_torques(self, qpos: np.ndarray, qvel: np.ndarray) -> np.ndarray:
        """Return the torques of the stops [N·m; N], shape (nv,), for qpos (nq,) and qvel (nv,)."""
        torques, positions = np.zeros(len(qvel)), qpos[self.qpos]
        beyond = positions - np.clip(positions, self.low, self.high)
        speeds = qvel[self.dof] * (beyond != 0)
        torques[self.dof] = -self.stiffness * (beyond + self.loss_time * speeds)
        return torques


def find_yielding_stops(model: mujoco.MjModel) -> list[int]:
    """Return the joints whose stops yield and are soft enough for the timestep."""
    soft = model.jnt_limited.astype(bool) & (model.jnt_solref[:, 0] < 0) & (model.jnt_solimp[:, 0] < RESOLVED)
    return [int(joint) for joint in np.flatnonzero(soft)]
