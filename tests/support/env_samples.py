"""Episodes of environments, and networks small enough to run in them."""

import numpy as np
import torch

from nas_data.envs.ergo_reacher import TASK
from nas_data.models.checkpoint import save
from nas_data.models.lstm import DynamicsModel


def small_model(folder, kind="delta", joints=TASK.joints, fps=1 / TASK.period, gain=1.0):
    """A checkpoint with random weights, its output scaled by `gain`."""
    torch.manual_seed(0)
    model = DynamicsModel(kind, joints, hidden=8, layers=1, fps=fps)
    with torch.no_grad():
        for layer in (model.outer, model.shortcut):
            layer.weight.mul_(gain)
            layer.bias.mul_(gain)
    return str(save(model, folder))


def play(env, steps=60):
    """Return the observations and rewards of an episode under fixed actions."""
    rng = np.random.default_rng(0)
    taken = [env.step(rng.uniform(-1, 1, 4).astype(np.float32))[:2] for _ in range(steps)]
    return np.array([[*observation, reward] for observation, reward in taken])
