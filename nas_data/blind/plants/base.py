"""What a plant is: an arm with something hidden in it that plays commands and shows where its links are."""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Protocol, TypeAlias

import numpy as np

from nas_data import registry
from nas_data.blind.arms import Arm
from nas_data.blind.plants.body import Body, stacked
from nas_data.blind.plants.chain import Chain
from nas_data.blind.plants.constants import Constants
from nas_data.blind.plants.hiding import hide
from nas_data.blind.plants.vectors import cross
from nas_data.blind.truth import Truth
from nas_data.errors import UnknownName

SUFFIX = "_plant"  # of the files that are plants
SETTLE = 0.5  # [s] for which the first pose is commanded before an episode begins, unless said otherwise


# states (C, E, T + 1, 2n) of an arm under C truths with commands (E, T, n) from poses (E, n) at a control period [s]
Simulate: TypeAlias = Callable[[Arm, Sequence[Truth], np.ndarray, np.ndarray, float], np.ndarray]
# the same of C arms alike
SimulateAlike: TypeAlias = Callable[[list[Body], np.ndarray, np.ndarray, float], np.ndarray]


class Play(Protocol):
    """Plays the same episodes on an arm under each of several truths."""

    def __call__(
        self,
        arm: Arm,
        truths: Sequence[Truth],
        commands: np.ndarray,
        poses: np.ndarray,
        period: float,
        settle: float = SETTLE,
    ) -> np.ndarray:
        """Return where the links are and how fast, without noise.

        Args:
            arm: Nominal arm.
            truths: What is hidden; each is played.
            commands: Commanded positions [rad], shape (E, T, n).
            poses: Commanded before each episode [rad], shape (E, n).
            period: Control period [s].
            settle: For how long they are [s].

        Returns:
            Positions [rad], then velocities [rad/s], before the first command and after each, shape
            (len(truths), E, T + 1, 2n).
        """


def find_plant(name: str) -> Play:
    """Return a plant's `play` by its name, `numpy` for the file `numpy_plant.py`.

    Raises:
        UnknownName: there is no such plant; lists those there are.
    """
    plants = [file.removesuffix(SUFFIX) for file in registry.names("blind.plants") if file.endswith(SUFFIX)]
    if name not in plants:
        raise UnknownName("plant", name, plants)
    play: Play = registry.module("blind.plants", name + SUFFIX, "plant").play
    return play


def player(simulate: Simulate) -> Play:
    """Return a plant's `play` from its simulation."""

    def play(
        arm: Arm,
        truths: Sequence[Truth],
        commands: np.ndarray,
        poses: np.ndarray,
        period: float,
        settle: float = SETTLE,
    ) -> np.ndarray:
        whole, held = with_settling(commands, poses, period, settle)
        return simulate(arm, truths, whole, poses, period)[:, :, held:]

    return play


def in_groups(simulate: SimulateAlike) -> Simulate:
    """Return a simulation under any truths from one of arms that are alike."""

    def every(arm: Arm, truths: Sequence[Truth], commands: np.ndarray, poses: np.ndarray, period: float) -> np.ndarray:
        episodes, steps, n = commands.shape
        result = np.empty((len(truths), episodes, steps + 1, 2 * n))
        for rows, bodies in alike(arm, truths):
            result[rows] = simulate(bodies, commands, poses, period)
        return result

    return every


def with_settling(
    commands: np.ndarray, poses: np.ndarray, period: float, settle: float = SETTLE
) -> tuple[np.ndarray, int]:
    """Return commands preceded by the held pose, and how many control periods that takes."""
    held = max(1, math.ceil(settle / period - 1e-9))
    return np.concatenate([np.repeat(poses[:, None], held, axis=1), commands], axis=1), held


def alike(arm: Arm, truths: Sequence[Truth]) -> Iterator[tuple[list[int], list[Body]]]:
    """Group truths whose arms have equally many links, so that each group can be stacked."""
    constants = Constants.of(arm.model())
    bodies = [hide(constants, truth) for truth in truths]
    for links in sorted({len(body.masses) for body in bodies}):
        rows = [row for row, body in enumerate(bodies) if len(body.masses) == links]
        yield rows, [bodies[row] for row in rows]


def starting(body: Body, poses: np.ndarray) -> np.ndarray:
    """Return the links' first angles (E, n): the pose, and a load that swings hanging straight down."""
    if len(body.masses) == body.driven:
        return poses
    whole = np.concatenate([poses, np.zeros((len(poses), 1))], axis=1)
    rotations = chain_of(stacked([body], len(poses))).frames(whole)[0][:, -1]
    rod = rotations @ body.centres[-1]
    across = cross(rotations @ body.axes[-1], rod)
    whole[:, -1] = np.arctan2(across @ body.gravity, rod @ body.gravity)
    return whole


def chain_of(numbers: dict[str, np.ndarray]) -> Chain:
    """Return the rigid bodies of stacked arms."""
    return Chain(*(numbers[key] for key in ("offsets", "turns", "axes", "masses", "centres", "inertias", "gravity")))


def told(body: Body, commands: np.ndarray) -> np.ndarray:
    """Return commands (E, T, n) with zeros for links that nothing drives."""
    undriven = len(body.masses) - body.driven
    return np.concatenate([commands, np.zeros((*commands.shape[:2], undriven))], axis=2)
