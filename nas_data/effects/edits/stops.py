"""Stops of a joint's range, rigid or yielding in proportion to their load."""

import mujoco
import numpy as np

from nas_data.mjcf.stop_stiffness import compute_stop_stiffness

HARD_STOP = (0.99, 0.999, 0.001, 0.5, 2.0)  # solimp: the servo's torque deforms the stop by less than 1e-4 rad
DAMPING_RATIO = 1.0  # of a link on its stop, rigid or yielding
SOFTEST, HARDEST = 2e-4, 0.99  # impedances of yielding stops; MuJoCo needs 1e-4


def soften_stops(spec: mujoco.MjSpec, joint: mujoco.MjsJoint, stiffness: float) -> None:
    """Give the stops of a joint a stiffness [N·m/rad], in series with that of stops that yield already.

    A limit is a spring of −solref₀ / ((1 − d) · w), with its impedance d and the joint's inverse inertia w at the
    reference posture; the inertia 1 / w on that spring is critically damped. The limit has a virtual mass of
    d / ((1 − d) · w), which is chosen as (2 · timestep)² · stiffness: hardly any for a soft stop, and as much as the
    timestep needs for a hard one.

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
    loss = 2 * DAMPING_RATIO * np.sqrt(total / weight)  # [N·m·s/rad]
    joint.solref_limit = -(1 - impedance) * weight * np.array([total, loss])
