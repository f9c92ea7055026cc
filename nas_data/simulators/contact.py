"""Contacts of a model in given poses: with itself, the floor or objects."""

import mujoco
import numpy as np

from nas_data.simulators.mujoco import MujocoSimulator

ContactDistances = dict[tuple[str, str], float]
"""Distance [m] of each pair of bodies in contact; negative if they overlap."""


def count_contacts(simulator: MujocoSimulator, positions: np.ndarray) -> np.ndarray:
    """Return the number of contacts, shape (N,), in poses [rad], shape (N, n)."""
    data = mujoco.MjData(simulator.model)
    counts = np.empty(len(positions), int)
    for row, pose in enumerate(positions):
        _compute_contacts(simulator, data, pose)
        counts[row] = data.ncon
    return counts


def find_contacts(simulator: MujocoSimulator, pose: np.ndarray, data: mujoco.MjData | None = None) -> ContactDistances:
    """Return the pairs of bodies in contact.

    Args:
        simulator: Simulator with the model.
        pose: Joint positions [rad], shape (n,).
        data: Scratch data, to save the time of its creation; created if None.
    """
    data, found = mujoco.MjData(simulator.model) if data is None else data, ContactDistances()
    _compute_contacts(simulator, data, pose)
    for contact in data.contact:
        pair = (_find_body_name(simulator, contact.geom1), _find_body_name(simulator, contact.geom2))
        found[pair] = min(found.get(pair, np.inf), float(contact.dist))
    return found


def _compute_contacts(simulator: MujocoSimulator, data: mujoco.MjData, pose: np.ndarray) -> None:
    """Compute the contacts of a pose [rad], shape (n,), in `data`."""
    data.qpos[simulator.layout.qpos] = pose
    mujoco.mj_kinematics(simulator.model, data)
    mujoco.mj_comPos(simulator.model, data)
    mujoco.mj_collision(simulator.model, data)


def _find_body_name(simulator: MujocoSimulator, geom: int) -> str:
    """Return the name of a geom's body; the geom's own name if that is the world."""
    body = int(simulator.model.geom_bodyid[geom])
    return str(simulator.model.body(body).name if body else simulator.model.geom(geom).name)
