"""Contacts during an experiment, which is reduced until there are none."""

from collections.abc import Callable

import mujoco
import numpy as np

from nas_data.gap.experiments.command_limits import CommandRange
from nas_data.simulators.mujoco import MujocoSimulator

SHARES = (1.0, 0.6, 0.35, 0.2)  # shares of the command range, tried in this order
LOOK = 0.05  # [s] between contact checks


def draw_without_contact(
    simulator: MujocoSimulator, room: CommandRange, draw: Callable[[CommandRange], np.ndarray]
) -> np.ndarray:
    """Draw an experiment in a range that is reduced until nothing touches, down to the smallest share.

    Args:
        simulator: Given model.
        room: Range of commands.
        draw: Draws commands within a range, shape (T, n), with the same random numbers each time.
    """
    for share in SHARES:
        commands = draw(room.shrink(share))
        if not has_new_contacts(simulator, room, commands):
            break
    return commands


def has_new_contacts(simulator: MujocoSimulator, room: CommandRange, commands: np.ndarray) -> bool:
    """Whether an experiment causes more contacts than the rest pose has."""
    n = len(room.pose)
    initial = np.concatenate([room.pose, np.zeros(n)])[None]
    path = simulator.rollout(initial, commands[None])[0, :: room.steps(LOOK), :n]
    counts = [count_contacts(simulator, positions) for positions in (room.pose, *path)]
    return max(counts) > counts[0]


def count_contacts(simulator: MujocoSimulator, positions: np.ndarray) -> int:
    """Return the number of contacts in a pose [rad; m], shape (n,)."""
    data = mujoco.MjData(simulator.model)
    data.qpos[simulator.layout.qpos] = positions
    mujoco.mj_kinematics(simulator.model, data)
    mujoco.mj_comPos(simulator.model, data)
    mujoco.mj_collision(simulator.model, data)
    return int(data.ncon)
