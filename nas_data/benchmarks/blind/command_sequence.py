"""What is played to a plant: commands, and how each episode begins."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from nas_data.benchmarks.blind.truth import Truth


@dataclass(frozen=True)
class CommandSequence:
    """Commands of E episodes of n joints."""

    commands: np.ndarray  # positions [rad] or torques [N m], shape (E, T, n)
    poses: np.ndarray  # commanded before each episode, or where it begins [rad], shape (E, n)
    # how fast the links are when it begins [rad/s], shape (E, n); None where they rest
    start_speeds: np.ndarray | None = None

    def __getitem__(self, episodes: slice) -> "CommandSequence":
        """Return some of the episodes."""
        speeds = None if self.start_speeds is None else self.start_speeds[episodes]
        return CommandSequence(self.commands[episodes], self.poses[episodes], speeds)


Script = Callable[
    [str, Truth], CommandSequence
]  # plant, truth → what is played; a controller's commands depend on both
