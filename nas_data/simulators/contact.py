"""Which poses of a model touch something: itself, the floor, an object."""

import mujoco
import numpy as np

from nas_data.simulators.mujoco import MujocoSimulator

Touches = dict[tuple[str, str], float]
"""Distance [m] of each pair of bodies that touch, negative where they overlap."""


def contact_counts(simulator: MujocoSimulator, positions: np.ndarray) -> np.ndarray:
    """Return how many contacts the model has in poses [rad], shape (N, n): shape (N,)."""
    data = mujoco.MjData(simulator.model)
    counts = np.empty(len(positions), int)
    for row, pose in enumerate(positions):
        _collide(simulator, data, pose)
        counts[row] = data.ncon
    return counts


def touches(simulator: MujocoSimulator, pose: np.ndarray, data: mujoco.MjData | None = None) -> Touches:
    """Return what touches what in a pose [rad], shape (n,).

    Args:
        simulator: The model.
        pose: Where its joints are.
        data: Room to compute in, which takes longer to make than to fill; made where not given.
    """
    data, found = mujoco.MjData(simulator.model) if data is None else data, Touches()
    _collide(simulator, data, pose)
    for contact in data.contact:
        pair = (_body(simulator, contact.geom1), _body(simulator, contact.geom2))
        found[pair] = min(found.get(pair, np.inf), float(contact.dist))
    return found


def _collide(simulator: MujocoSimulator, data: mujoco.MjData, pose: np.ndarray) -> None:
    """Find the contacts of a pose [rad], shape (n,)."""
    data.qpos[simulator.layout.qpos] = pose
    mujoco.mj_kinematics(simulator.model, data)
    mujoco.mj_comPos(simulator.model, data)
    mujoco.mj_collision(simulator.model, data)


def _body(simulator: MujocoSimulator, geom: int) -> str:
    """Return the name of the body that a geom belongs to; the geom's own for what stands in the world."""
    body = int(simulator.model.geom_bodyid[geom])
    return str(simulator.model.body(body).name if body else simulator.model.geom(geom).name)
