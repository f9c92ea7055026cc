"""Interface of a plant: an arm with hidden effects that plays commands and returns its true states."""

import math
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, fields
from typing import TypeAlias

import numpy as np

from nas_data import registry
from nas_data.benchmarks.blind.arms import NominalArm
from nas_data.benchmarks.blind.case import Truth
from nas_data.benchmarks.blind.plants.chain import Chain
from nas_data.benchmarks.blind.plants.constants import Constants
from nas_data.benchmarks.blind.plants.drive import Drive
from nas_data.benchmarks.blind.plants.hiding import PlantBody, hide, stack_arms
from nas_data.benchmarks.blind.plants.motion import REFRESH, PlantState
from nas_data.benchmarks.blind.plants.vectors import cross
from nas_data.errors import UnknownName

SUFFIX = "_plant"  # of the file names of plants
SETTLE = 0.5  # [s] default time for which the first pose is commanded before an episode begins


# index of the control period, true states (C E, 2n) → commands (C E, n) of that period
Feedback: TypeAlias = Callable[[int, np.ndarray], np.ndarray]
# Simulates an arm under C truths: commands (E, T, n), initial states (E, 2n), control period [s], optional feedback in
# place of the commands → states (C, E, T + 1, 2n).
Simulate: TypeAlias = Callable[
    [NominalArm, Sequence[Truth], np.ndarray, np.ndarray, float, Feedback | None], np.ndarray
]
# C arms with equally many links, their stacked constants, their state → context manager of a function that advances
# them by `REFRESH`
OpenPhysics: TypeAlias = Callable[
    [list[PlantBody], dict[str, np.ndarray], PlantState], AbstractContextManager[Callable[[], None]]
]


@dataclass(frozen=True)
class Play:
    """Plays the same episodes on an arm under each of several truths."""

    simulate: Simulate  # simulates episodes from given states

    def __call__(
        self,
        arm: NominalArm,
        truths: Sequence[Truth],
        commands: np.ndarray,
        poses: np.ndarray,
        period: float,
        settle: float = SETTLE,
        speeds: np.ndarray | None = None,
        feedback: Feedback | None = None,
    ) -> np.ndarray:
        """Return true positions and velocities, without noise.

        Args:
            arm: Nominal arm.
            truths: Hidden effects; each truth is simulated.
            commands: Commanded positions [rad] or torques [N m], shape (E, T, n).
            poses: Pose commanded before each episode, or its first pose [rad], shape (E, n).
            period: Control period [s].
            settle: Time for which the poses are commanded [s]; unused for episodes that begin in motion.
            speeds: Initial speeds [rad/s], shape (E, n); None for rest.
            feedback: Computes the commands of each control period instead of `commands`; one truth only.

        Returns:
            Positions [rad], then velocities [rad/s], before the first command and after each, shape (len(truths), E, T
            + 1, 2n).
        """
        if speeds is not None:
            return self.simulate(arm, truths, commands, np.concatenate([poses, speeds], axis=1), period, feedback)
        held = max(1, math.ceil(settle / period - 1e-9))  # control periods for which the poses are commanded
        whole = np.concatenate([np.repeat(poses[:, None], held, axis=1), commands], axis=1)
        rest = np.concatenate([poses, np.zeros_like(poses)], axis=1)
        return self.simulate(arm, truths, whole, rest, period, feedback)[:, :, held:]


def find_plant(name: str) -> Play:
    """Return a plant's `play` by name: `numpy` is in the file `numpy_plant.py`.

    Raises:
        UnknownName: there is no such plant; lists the plants.
    """
    plants = [
        file.removesuffix(SUFFIX) for file in registry.list_names("benchmarks.blind.plants") if file.endswith(SUFFIX)
    ]
    if name not in plants:
        raise UnknownName("plant", name, plants)
    play: Play = registry.import_plugin("benchmarks.blind.plants", name + SUFFIX, "plant").play
    return play


def make_simulation(open_physics: OpenPhysics) -> Simulate:
    """Return a simulation of drives and links that batches arms with the same rows of links."""

    def simulate(
        arm: NominalArm,
        truths: Sequence[Truth],
        commands: np.ndarray,
        starts: np.ndarray,
        period: float,
        feedback: Feedback | None,
    ) -> np.ndarray:
        constants = Constants.of(arm.model())
        bodies = [hide(constants, truth) for truth in truths]
        result = np.empty((len(truths), len(commands), commands.shape[1] + 1, starts.shape[1]))
        for kind in sorted({(len(body.masses), body.driven) for body in bodies}):
            rows = [row for row, body in enumerate(bodies) if (len(body.masses), body.driven) == kind]
            alike = [bodies[row] for row in rows]
            result[rows] = simulate_batch(open_physics, alike, commands, starts, period, feedback)
        return result

    return simulate


def simulate_batch(
    open_physics: OpenPhysics,
    bodies: list[PlantBody],
    commands: np.ndarray,
    starts: np.ndarray,
    period: float,
    feedback: Feedback | None,
) -> np.ndarray:
    """Return states (C, E, T + 1, 2n) of C arms with the same rows, commands (E, T, n), initial states (E, 2n)."""
    episodes, steps, n = commands.shape
    numbers = stack_arms(bodies, episodes)
    # C arms times E episodes, the episodes of an arm in adjacent rows
    first = np.concatenate([compute_start_states(body, starts) for body in bodies])
    tiled = np.tile(pad_commands(bodies[0], commands), (len(bodies), 1, 1))
    state = PlantState(Drive.of(numbers), tiled, period, first)
    measured = np.empty((len(first), steps + 1, 2 * n))
    rows = list(bodies[0].driven)
    measured[:, 0] = state.measure(rows)
    with open_physics(bodies, numbers, state) as move:
        for step in range(steps):
            if feedback is not None:
                state.set_commands(step, pad_commands(bodies[0], feedback(step, measured[:, step])[:, None])[:, 0])
            for _ in range(round(period / REFRESH)):
                move()
            measured[:, step + 1] = state.measure(rows)
    return measured.reshape(len(bodies), episodes, steps + 1, 2 * n)


def compute_start_states(body: PlantBody, starts: np.ndarray) -> np.ndarray:
    """Return the links' initial angles, then speeds (E, 2n); a swinging load hangs down, a bending link is straight."""
    poses, speeds = (pad_commands(body, part[:, None])[:, 0] for part in np.split(starts, 2, axis=1))
    if body.driven[-1] < len(body.masses) - 1 and not body.gain[-1]:
        rotations = make_chain(stack_arms([body], len(poses))).frames(poses)[0][:, -1]
        rod = rotations @ body.centres[-1]
        across = cross(rotations @ body.axes[-1], rod)
        poses[:, -1] = np.arctan2(across @ body.gravity, rod @ body.gravity)
    return np.concatenate([poses, speeds], axis=1)


def make_chain(numbers: dict[str, np.ndarray]) -> Chain:
    """Return the rigid-body chain of stacked arms."""
    return Chain(*(numbers[field.name] for field in fields(Chain)))


def pad_commands(body: PlantBody, commands: np.ndarray) -> np.ndarray:
    """Return commands (E, T, n) with zeros for undriven links."""
    padded = np.zeros((*commands.shape[:2], len(body.masses)))
    padded[..., list(body.driven)] = commands
    return padded
