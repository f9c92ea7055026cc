"""Episodes as tensors, for training."""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields

import numpy as np
import torch
from torch import Tensor

from nas_data.dataset.dataset import Dataset
from nas_data.pairing import read_object_states
from nas_data.simulators.base import Simulator


@dataclass(frozen=True)
class Episode:
    """One measured episode of T transitions.

    Attributes:
        states: Measured, shape (T, 2n).
        commands: Shape (T, n).
        predicted: Simulated next states, shape (T, 2n); the states themselves if the dataset is not paired.
        targets: Measured next states, shape (T, 2n).
        objects: Measured states of the source's objects before each command, shape (T, m); (T, 0) without objects.
    """

    states: Tensor
    commands: Tensor
    predicted: Tensor
    targets: Tensor
    objects: Tensor = field(default_factory=lambda: torch.empty(0))

    def __post_init__(self) -> None:
        if self.objects.ndim < self.states.ndim:
            object.__setattr__(self, "objects", self.states[..., :0])

    def __len__(self) -> int:
        return len(self.states)

    def window(self, start: int, length: int) -> "Episode":
        """Return `length` consecutive transitions from `start` on."""
        rows = slice(start, start + length)
        return Episode(*(getattr(self, name)[rows] for name in FIELDS))


FIELDS = tuple(part.name for part in fields(Episode))


def read_episodes(
    dataset: Dataset, indices: Sequence[int] | None = None, simulator: Simulator | None = None
) -> list[Episode]:
    """Return episodes of a dataset as float32 tensors.

    Args:
        dataset: Transitions.
        indices: Indices of the episodes; all if None.
        simulator: Source whose object states are read; no objects if None.
    """
    predicted = dataset.sim_states if dataset.paired else dataset.states
    columns = [dataset.states, dataset.commands, predicted, dataset.next_states]
    columns += [] if simulator is None else [read_object_states(dataset, simulator)]
    tensors = [torch.from_numpy(np.require(column, np.float32, ["C", "W"])) for column in columns]
    return [
        Episode(*(tensor[dataset.episode(index)] for tensor in tensors))
        for index in (range(dataset.n_episodes) if indices is None else indices)
    ]


def join(episodes: Sequence[Episode]) -> Episode:
    """Concatenate the transitions of several episodes, for statistics."""
    return Episode(*(torch.cat([getattr(episode, name) for episode in episodes]) for name in FIELDS))


def pad(episodes: Sequence[Episode]) -> tuple[Episode, Tensor]:
    """Return episodes as one batch (B, T, …), padded with their last frame, and the mask of recorded frames (B, T)."""
    longest = max(len(episode) for episode in episodes)

    def stretch(values: Tensor) -> Tensor:
        return torch.cat([values, values[-1:].expand(longest - len(values), -1)])

    batch = Episode(*(torch.stack([stretch(getattr(episode, name)) for episode in episodes]) for name in FIELDS))
    mask = torch.stack([torch.arange(longest) < len(episode) for episode in episodes])
    return batch, mask


def cut_episodes(episodes: Sequence[Episode], longest: int) -> list[Episode]:
    """Cut episodes into segments of at most `longest` frames; 0 keeps them whole."""
    if not longest:
        return list(episodes)
    pieces: list[Episode] = []
    for episode in episodes:
        starts = range(0, len(episode), longest)
        pieces.extend(episode.window(start, min(longest, len(episode) - start)) for start in starts)
    return pieces
