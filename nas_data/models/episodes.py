"""Episodes as tensors: what both training phases read."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from nas_data.dataset.dataset import Dataset


@dataclass(frozen=True)
class Episode:
    """One measured episode of T transitions.

    Attributes:
        states: Measured, shape (T, 2n).
        commands: Shape (T, n).
        predicted: Simulated next states, shape (T, 2n); the states themselves where the dataset is not paired.
        targets: Measured next states, shape (T, 2n).
    """

    states: Tensor
    commands: Tensor
    predicted: Tensor
    targets: Tensor

    def __len__(self) -> int:
        return len(self.states)

    def window(self, start: int, length: int) -> "Episode":
        """Return some consecutive transitions."""
        rows = slice(start, start + length)
        return Episode(self.states[rows], self.commands[rows], self.predicted[rows], self.targets[rows])


def read_episodes(dataset: Dataset, indices: Sequence[int] | None = None) -> list[Episode]:
    """Return episodes of a dataset, all where None, as float32 tensors."""
    predicted = dataset.sim_states if dataset.paired else dataset.states
    columns = [dataset.states, dataset.commands, predicted, dataset.next_states]
    tensors = [torch.from_numpy(np.ascontiguousarray(column, dtype=np.float32)) for column in columns]
    return [
        Episode(*(tensor[dataset.episode(index)] for tensor in tensors))
        for index in (range(dataset.n_episodes) if indices is None else indices)
    ]


def join(episodes: Sequence[Episode]) -> Episode:
    """Return the transitions of several episodes in one; for statistics, not for memory."""
    fields = ("states", "commands", "predicted", "targets")
    return Episode(*(torch.cat([getattr(episode, name) for episode in episodes]) for name in fields))


def pad(episodes: Sequence[Episode]) -> tuple[Episode, Tensor]:
    """Return episodes as one batch (B, T, …), padded by their last frame, and the mask (B, T) of true frames."""
    longest = max(len(episode) for episode in episodes)
    fields = ("states", "commands", "predicted", "targets")

    def stretch(values: Tensor) -> Tensor:
        return torch.cat([values, values[-1:].expand(longest - len(values), -1)])

    batch = Episode(*(torch.stack([stretch(getattr(episode, name)) for episode in episodes]) for name in fields))
    mask = torch.stack([torch.arange(longest) < len(episode) for episode in episodes])
    return batch, mask


def cut(episodes: Sequence[Episode], longest: int) -> list[Episode]:
    """Cut episodes into pieces of at most `longest` frames; 0 keeps them whole."""
    if not longest:
        return list(episodes)
    pieces: list[Episode] = []
    for episode in episodes:
        starts = range(0, len(episode), longest)
        pieces.extend(episode.window(start, min(longest, len(episode) - start)) for start in starts)
    return pieces
