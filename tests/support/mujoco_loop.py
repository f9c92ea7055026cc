"""A recording loop on MuJoCo alone, independent of the project's simulators."""

import mujoco
import numpy as np

SUBSTEPS = 10  # physics steps of a control step


def play(model: mujoco.MjModel, commands: np.ndarray, settled: int) -> np.ndarray:
    """Return the positions before each command and after the last, shape (T + 1, n).

    Args:
        model: Arm with one actuator for each joint.
        commands: Shape (T, n).
        settled: Physics steps under the first command before the episode.
    """
    data = mujoco.MjData(model)
    data.ctrl[:] = commands[0]
    mujoco.mj_step(model, data, settled)
    rows = [data.qpos.copy()]
    for command in commands:
        data.ctrl[:] = command
        mujoco.mj_step(model, data, SUBSTEPS)
        rows.append(data.qpos.copy())
    return np.array(rows)
