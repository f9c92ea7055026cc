"""What trains and what validates: whole episodes where there are many, the end of each where there are few."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nas_data.dataset.dataset import Dataset
from nas_data.errors import DatasetInvalid

MANY = 20  # episodes; fewer are too different from each other for a draw of one or two to stand for all


@dataclass(frozen=True)
class HeldOut:
    """A split of a dataset for early stopping.

    Attributes:
        train: Episodes, or the beginnings of episodes, that train.
        held: Those that validate; none of their frames trains.
        what: Says which, for people and for the checkpoint.
    """

    train: Dataset
    held: Dataset
    what: str


def hold_out(dataset: Dataset, share: float, seed: int) -> HeldOut:
    """Split a dataset for early stopping.

    Args:
        dataset: Transitions.
        share: Share that validates, at least one episode (or one frame of each).
        seed: Seed of the draw of whole episodes.

    Raises:
        DatasetInvalid: nothing is left to train on.
    """
    count = dataset.n_episodes
    if count >= MANY:
        order = np.random.default_rng(seed).permutation(count)
        held = min(count - 1, max(1, round(share * count)))
        chosen, others = sorted(order[:held].tolist()), sorted(order[held:].tolist())
        return HeldOut(dataset.select(others), dataset.select(chosen), f"episodes {', '.join(map(str, chosen))}")
    held_frames = np.clip(np.round(share * dataset.lengths).astype(int), 1, np.maximum(1, dataset.lengths - 1))
    cuts = dataset.lengths - held_frames
    pieces = [(start, start + cut) for start, cut in zip(dataset.starts, cuts, strict=True) if cut > 0]
    if not pieces:
        raise DatasetInvalid("No episode has two transitions, one to train on and one to validate; record longer ones.")
    ends = list(zip(dataset.starts + cuts, dataset.starts + dataset.lengths, strict=True))
    what = f"the last {share:.0%} of each episode (fewer than {MANY} episodes)"
    return HeldOut(rows_of(dataset, pieces), rows_of(dataset, ends), what)


def rows_of(dataset: Dataset, pieces: Sequence[tuple[int, int]]) -> Dataset:
    """Return runs of consecutive frames, each as an episode of its own."""
    frames = np.concatenate([np.arange(start, stop) for start, stop in pieces])
    columns = {key: column[frames] for key, column in dataset.columns.items()}
    lengths = np.array([stop - start for start, stop in pieces])
    return Dataset(dataset.features, columns, lengths, dataset.fps, dataset.robot_type)
