"""Whether an arm would hit itself or the floor in an experiment: then collisions, not drives, would be compared."""

from collections.abc import Callable

import mujoco
import numpy as np

from nas_data.gap.experiments.command_limits import CommandRange
from nas_data.simulators.mujoco import MujocoSimulator

SHARES = (1.0, 0.6, 0.35, 0.2)  # of the way from rest that an experiment may take, tried in this order
LOOK = 0.05  # [s] between two looks at a motion


def draw_without_contact(
    simulator: MujocoSimulator, room: CommandRange, draw: Callable[[CommandRange], np.ndarray]
) -> np.ndarray:
    """Draw an experiment, with its motion reduced until nothing touches, at most to the smallest share.

    Args:
        simulator: Model as handed over.
        room: What may be commanded.
        draw: Draws the commands within a room, shape (T, n); the same randomness each time.
    """
    for share in SHARES:
        commands = draw(room.shrink(share))
        if not has_new_contacts(simulator, room, commands):
            break
    return commands


def has_new_contacts(simulator: MujocoSimulator, room: CommandRange, commands: np.ndarray) -> bool:
    """Whether more touches during an experiment than at rest."""
    n = len(room.pose)
    initial = np.concatenate([room.pose, np.zeros(n)])[None]
    path = simulator.rollout(initial, commands[None])[0, :: room.steps(LOOK), :n]
    counts = [count_contacts(simulator, positions) for positions in (room.pose, *path)]
    return max(counts) > counts[0]


def count_contacts(simulator: MujocoSimulator, positions: np.ndarray) -> int:
    """Return how many contacts the model has in a pose [rad], shape (n,)."""
    data = mujoco.MjData(simulator.model)
    data.qpos[simulator.layout.qpos] = positions
    mujoco.mj_kinematics(simulator.model, data)
    mujoco.mj_comPos(simulator.model, data)
    mujoco.mj_collision(simulator.model, data)
    return int(data.ncon)
