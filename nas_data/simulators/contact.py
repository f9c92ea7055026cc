"""Contacts of a model in given poses: with itself, the floor or objects."""

import mujoco
import numpy as np

from nas_data.mjcf.free_bodies import find_free_bodies
from nas_data.simulators.mujoco import MujocoSimulator
from nas_data.simulators.poses import complete_poses

MIN_OVERLAP = 0.002  # [m] bodies that touch each other, or rest on each other, overlap less
LASTING_SHARE = 0.9  # least share of poses with an overlap

ContactDistances = dict[tuple[str, str], float]
"""Distance [m] of each pair of bodies in contact; negative if they overlap."""


def count_contacts(simulator: MujocoSimulator, positions: np.ndarray) -> np.ndarray:
    """Return the number of contacts, shape (N,), in poses [rad; m], shape (N, n)."""
    data = mujoco.MjData(simulator.model)
    counts = np.empty(len(positions), int)
    for row, qpos in enumerate(_complete_poses(simulator, positions)):
        _compute_contacts(simulator.model, data, qpos)
        counts[row] = data.ncon
    return counts


def find_contacts(simulator: MujocoSimulator, pose: np.ndarray, data: mujoco.MjData | None = None) -> ContactDistances:
    """Return the pairs of bodies in contact.

    Args:
        simulator: Simulator with the model.
        pose: Joint positions [rad; m], shape (n,).
        data: Scratch data, to save the time of its creation; created if None.
    """
    data, found = mujoco.MjData(simulator.model) if data is None else data, ContactDistances()
    _compute_contacts(simulator.model, data, _complete_poses(simulator, pose[None])[0])
    for contact in data.contact:
        pair = (_find_body_name(simulator, contact.geom1), _find_body_name(simulator, contact.geom2))
        found[pair] = min(found.get(pair, np.inf), float(contact.dist))
    return found


def find_lasting_overlaps(simulator: MujocoSimulator, positions: np.ndarray) -> dict[tuple[int, int], float]:
    """Return the pairs of bodies, by index, that overlap in nearly all poses, as shapes that are too wide do.

    Args:
        simulator: Simulator with the model.
        positions: Joint positions [rad; m], shape (N, n).

    Returns:
        Smallest distance in any pose [m]; pairs with an object that moves freely are left out.
    """
    model, data = simulator.model, mujoco.MjData(simulator.model)
    free, found = find_free_bodies(model), dict[tuple[int, int], list[float]]()
    for qpos in _complete_poses(simulator, positions):
        _compute_contacts(model, data, qpos)
        depths: dict[tuple[int, int], float] = {}
        for contact in data.contact:
            one, other = sorted(int(body) for body in model.geom_bodyid[contact.geom])
            if contact.dist < -MIN_OVERLAP and not free[[one, other]].any():
                depths[one, other] = min(depths.get((one, other), 0.0), float(contact.dist))
        for pair, depth in depths.items():
            found.setdefault(pair, []).append(depth)
    return {
        (one, other): min(depths)
        for (one, other), depths in found.items()
        if len(depths) >= LASTING_SHARE * len(positions)
    }


def _complete_poses(simulator: MujocoSimulator, poses: np.ndarray) -> np.ndarray:
    """Return all positions of a simulator's model in poses [rad; m], shape (N, n); shape (N, nq)."""
    layout = simulator.layout
    return complete_poses(simulator.model, layout.qpos, layout.followers, poses)


def _compute_contacts(model: mujoco.MjModel, data: mujoco.MjData, qpos: np.ndarray) -> None:
    """Compute the contacts at positions (nq,) in `data`."""
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_collision(model, data)


def _find_body_name(simulator: MujocoSimulator, geom: int) -> str:
    """Return the name of a geom's body; the geom's own name if that is the world."""
    body = int(simulator.model.geom_bodyid[geom])
    return str(simulator.model.body(body).name if body else simulator.model.geom(geom).name)
