"""An arm written in NumPy from the equations alone, no physics engine beneath: every episode at once."""

import numpy as np

from nas_data.benchmarks.blind.plants.base import (
    Feedback,
    Play,
    compute_start_states,
    make_chain,
    make_grouped_simulation,
    pad_commands,
)
from nas_data.benchmarks.blind.plants.body import PlantBody, stack_arms
from nas_data.benchmarks.blind.plants.motion import PlantState
from nas_data.benchmarks.blind.plants.servo_model import REFRESH, Drive


def simulate(
    bodies: list[PlantBody], commands: np.ndarray, starts: np.ndarray, period: float, feedback: Feedback | None
) -> np.ndarray:
    """Return states (C, E, T + 1, 2n) of C arms alike under commands (E, T, n) from states (E, 2n)."""
    episodes, steps, n = commands.shape
    numbers = stack_arms(bodies, episodes)
    chain = make_chain(numbers)
    # C arms times E episodes, an arm's episodes side by side
    start = np.concatenate([compute_start_states(body, starts) for body in bodies])
    motion = PlantState(
        Drive.of(numbers), np.tile(pad_commands(bodies[0], commands), (len(bodies), 1, 1)), period, start
    )
    measured = np.empty((len(start), steps + 1, 2 * n))
    measured[:, 0] = motion.state(n)
    for step in range(steps):
        if feedback is not None:
            motion.tell(step, pad_commands(bodies[0], feedback(step, measured[:, step])[:, None])[:, 0])
        for _ in range(round(period / REFRESH)):
            motion.advance(*chain.dynamics(*motion.middle()))
        measured[:, step + 1] = motion.state(n)
    return measured.reshape(len(bodies), episodes, steps + 1, 2 * n)


play = Play(make_grouped_simulation(simulate))
