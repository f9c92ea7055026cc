"""What a plant is: an arm with something hidden in it that plays commands and shows where its links are."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields
from typing import TypeAlias

import numpy as np

from nas_data import registry
from nas_data.benchmarks.blind.arms import NominalArm
from nas_data.benchmarks.blind.plants.body import PlantBody, stack_arms
from nas_data.benchmarks.blind.plants.chain import Chain
from nas_data.benchmarks.blind.plants.constants import Constants
from nas_data.benchmarks.blind.plants.hiding import hide
from nas_data.benchmarks.blind.plants.vectors import cross
from nas_data.benchmarks.blind.truth import Truth
from nas_data.errors import UnknownName

SUFFIX = "_plant"  # of the files that are plants
SETTLE = 0.5  # [s] for which the first pose is commanded before an episode begins, unless said otherwise


# control period from zero, true states (C E, 2n) → commands (C E, n) of that period
Feedback: TypeAlias = Callable[[int, np.ndarray], np.ndarray]
# states (C, E, T + 1, 2n) of an arm under C truths with commands (E, T, n) from states (E, 2n) at a control period [s];
# feedback, where there is one, replaces the commands
Simulate: TypeAlias = Callable[
    [NominalArm, Sequence[Truth], np.ndarray, np.ndarray, float, Feedback | None], np.ndarray
]
# the same of C arms alike
SimulateAlike: TypeAlias = Callable[[list[PlantBody], np.ndarray, np.ndarray, float, Feedback | None], np.ndarray]


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
        """Return where the links are and how fast, without noise.

        Args:
            arm: Nominal arm.
            truths: What is hidden; each is played.
            commands: Commanded positions [rad] or torques [N m], shape (E, T, n).
            poses: Commanded before each episode, or where the links are when it begins [rad], shape (E, n).
            period: Control period [s].
            settle: For how long the poses are commanded [s]; an episode that begins in motion knows no before.
            speeds: How fast the links move when an episode begins [rad/s], shape (E, n); None where they rest.
            feedback: Gives the commands of each control period in the place of `commands`; one truth only.

        Returns:
            Positions [rad], then velocities [rad/s], before the first command and after each, shape
            (len(truths), E, T + 1, 2n).
        """
        if speeds is not None:
            return self.simulate(arm, truths, commands, np.concatenate([poses, speeds], axis=1), period, feedback)
        held = max(1, math.ceil(settle / period - 1e-9))  # control periods for which the poses are commanded
        whole = np.concatenate([np.repeat(poses[:, None], held, axis=1), commands], axis=1)
        rest = np.concatenate([poses, np.zeros_like(poses)], axis=1)
        return self.simulate(arm, truths, whole, rest, period, feedback)[:, :, held:]


def find_plant(name: str) -> Play:
    """Return a plant's `play` by its name, `numpy` for the file `numpy_plant.py`.

    Raises:
        UnknownName: there is no such plant; lists those there are.
    """
    plants = [
        file.removesuffix(SUFFIX) for file in registry.list_names("benchmarks.blind.plants") if file.endswith(SUFFIX)
    ]
    if name not in plants:
        raise UnknownName("plant", name, plants)
    play: Play = registry.import_plugin("benchmarks.blind.plants", name + SUFFIX, "plant").play
    return play


def make_grouped_simulation(simulate: SimulateAlike) -> Simulate:
    """Return a simulation under any truths from one of arms that are alike."""

    def every(
        arm: NominalArm,
        truths: Sequence[Truth],
        commands: np.ndarray,
        starts: np.ndarray,
        period: float,
        feedback: Feedback | None,
    ) -> np.ndarray:
        episodes, steps, n = commands.shape
        result = np.empty((len(truths), episodes, steps + 1, 2 * n))
        for rows, bodies in group_by_links(arm, truths):
            result[rows] = simulate(bodies, commands, starts, period, feedback)
        return result

    return every


def group_by_links(arm: NominalArm, truths: Sequence[Truth]) -> Iterator[tuple[list[int], list[PlantBody]]]:
    """Group truths whose arms have equally many links, so that each group can be stacked."""
    constants = Constants.of(arm.model())
    bodies = [hide(constants, truth) for truth in truths]
    for links in sorted({len(body.masses) for body in bodies}):
        rows = [row for row, body in enumerate(bodies) if len(body.masses) == links]
        yield rows, [bodies[row] for row in rows]


def compute_start_states(body: PlantBody, starts: np.ndarray) -> np.ndarray:
    """Return the links' first angles, then speeds (E, 2n): the start, and a load that swings hanging straight down."""
    if len(body.masses) == body.driven:
        return starts
    poses, speeds = np.split(starts, 2, axis=1)
    still = np.zeros((len(poses), 1))
    whole = np.concatenate([poses, still], axis=1)
    rotations = make_chain(stack_arms([body], len(poses))).frames(whole)[0][:, -1]
    rod = rotations @ body.centres[-1]
    across = cross(rotations @ body.axes[-1], rod)
    whole[:, -1] = np.arctan2(across @ body.gravity, rod @ body.gravity)
    return np.concatenate([whole, speeds, still], axis=1)


def make_chain(numbers: dict[str, np.ndarray]) -> Chain:
    """Return the rigid bodies of stacked arms."""
    return Chain(*(numbers[field.name] for field in fields(Chain)))


def pad_commands(body: PlantBody, commands: np.ndarray) -> np.ndarray:
    """Return commands (E, T, n) with zeros for links that nothing drives."""
    undriven = len(body.masses) - body.driven
    return np.concatenate([commands, np.zeros((*commands.shape[:2], undriven))], axis=2)
