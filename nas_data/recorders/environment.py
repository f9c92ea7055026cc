"""Open-loop episodes of an environment: its own starts, and an excitation in its action space."""

import numpy as np

from nas_data.envs.base import find_task
from nas_data.excitations.base import Excitation


def draw_actions(
    environment: str, excitation: Excitation, episodes: int, steps: int, rng: np.random.Generator
) -> list[np.ndarray]:
    """Draw the commands of an excitation in the action space.

    Args:
        environment: Name of the environment.
        excitation: Signal, scaled to the whole action space.
        episodes: Number of episodes, E.
        steps: Control steps of each, T.
        rng: Source of randomness.

    Returns:
        Positions [rad] or torques [N·m] of each episode, shape (T, n).
    """
    task = find_task(environment)
    low, high = task.action_space.low.astype(float), task.action_space.high.astype(float)
    return [task.command(rows) for rows in excitation.commands(rng, episodes, steps, task.period, low, high)]


def draw_environment_starts(environment: str, episodes: int, rng: np.random.Generator) -> np.ndarray:
    """Draw initial states, shape (E, 2n + m): positions [rad], velocities [rad/s], then states of objects."""
    task = find_task(environment)
    starts = [task.start(rng) for _ in range(episodes)]
    return np.stack([np.concatenate([start.state, start.objects]) for start in starts])
