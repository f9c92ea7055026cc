"""Split into training and validation data: by whole episodes, or at the end of each episode if there are few."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from nas_data.dataset.dataset import Dataset
from nas_data.errors import DatasetInvalid

STILL = 0.1  # share of the training data's speed below which validation data do not tell a good model from none
MIN_DRAWN_FROM = 20  # episodes; of fewer, one or two drawn episodes do not represent the others


@dataclass(frozen=True)
class ValidationSplit:
    """A split of a dataset for early stopping.

    Attributes:
        train: Training data: whole episodes, or their beginnings.
        validation: Validation data, without frames of the training data.
        description: Description of the validation data, for messages and the checkpoint.
    """

    train: Dataset
    validation: Dataset
    description: str

    @property
    def is_still(self) -> bool:
        """Whether the arm hardly moves in the validation data, in proportion to the training data."""
        n = len(self.train.joints)
        train, validation = (
            np.sqrt(np.square((part.next_states - part.states)[:, :n].astype(float)).mean(axis=0))
            for part in (self.train, self.validation)
        )
        moving = train > 0
        return bool(moving.any() and (validation[moving] < STILL * train[moving]).all())


def split_validation(dataset: Dataset, share: float, seed: int) -> ValidationSplit:
    """Split a dataset for early stopping.

    Args:
        dataset: Transitions.
        share: Share for validation, at least one episode, or one frame of each episode.
        seed: Seed of the random choice of episodes.

    Raises:
        DatasetInvalid: no training data remains.
    """
    count = dataset.n_episodes
    if count >= MIN_DRAWN_FROM:
        order = np.random.default_rng(seed).permutation(count)
        held_out = min(count - 1, max(1, round(share * count)))
        chosen, others = sorted(order[:held_out].tolist()), sorted(order[held_out:].tolist())
        held = dataset.select(chosen)
        return ValidationSplit(dataset.select(others), held, f"episodes {', '.join(map(str, held.numbers))}")
    held_frames = np.clip(np.round(share * dataset.lengths).astype(int), 1, np.maximum(1, dataset.lengths - 1))
    cuts = dataset.lengths - held_frames
    pieces = [(start, start + cut) for start, cut in zip(dataset.starts, cuts, strict=True) if cut > 0]
    if not pieces:
        raise DatasetInvalid("No episode has two transitions, one to train on and one to validate; record longer ones.")
    ends = list(zip(dataset.starts + cuts, dataset.starts + dataset.lengths, strict=True))
    description = f"the last {share:.0%} of each episode (fewer than {MIN_DRAWN_FROM} episodes)"
    held = replace(select_frames(dataset, ends), numbers=dataset.numbers)
    return ValidationSplit(select_frames(dataset, pieces), held, description)


def select_frames(dataset: Dataset, pieces: Sequence[tuple[int, int]]) -> Dataset:
    """Return ranges of consecutive frames (start, stop), each as one episode."""
    frames = np.concatenate([np.arange(start, stop) for start, stop in pieces])
    columns = {key: column[frames] for key, column in dataset.columns.items()}
    lengths = np.array([stop - start for start, stop in pieces])
    return Dataset(dataset.features, columns, lengths, dataset.fps, dataset.robot_type)
