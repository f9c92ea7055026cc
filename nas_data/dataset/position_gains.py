"""Position gains that the frames of a recording hold, as registers of the servos."""

from pathlib import Path

import numpy as np

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.torque_off import find_torque_on
from nas_data.errors import DatasetInvalid

P_GAIN_COLUMN = "nas.p_gain"  # P register of the servos, one for all joints or one each


def list_position_gains(dataset: Dataset) -> np.ndarray:
    """Return the different P registers of a dataset with `nas.p_gain` while the torque is on, shape (k, n).

    A register that is no gain, or of the wrong width, counts as one that is not the same in all rows: k is 2.
    """
    registers, n = dataset.columns[P_GAIN_COLUMN].astype(float)[find_torque_on(dataset)], len(dataset.joints)
    gains = np.unique(registers, axis=0)
    if registers.shape[1] not in (1, n) or not ((gains > 0) & (gains < np.inf)).all():
        return np.full((2, n), np.nan)
    return np.broadcast_to(gains, (len(gains), n))


def read_position_gains(dataset: Dataset, name: str | Path = "") -> np.ndarray:
    """Return the P register of each episode and joint of a dataset with `nas.p_gain`, shape (E, n).

    Rows without torque do not count, because some servos then report no gain. Episodes without other rows have 0.

    Args:
        dataset: Transitions.
        name: Name of the dataset in errors; empty for its folder.

    Raises:
        DatasetInvalid: it has neither one column nor one for each joint, or an episode has not one gain above 0.
    """
    registers, n = dataset.columns[P_GAIN_COLUMN].astype(float), len(dataset.joints)
    name = name or (dataset.origin.root if dataset.origin else None) or "the dataset"
    if registers.shape[1] not in (1, n):
        raise DatasetInvalid(
            f"{P_GAIN_COLUMN} of {name} has {registers.shape[1]} columns; give one for all joints or one for each."
        )
    gains, on = np.zeros((dataset.n_episodes, n)), find_torque_on(dataset)
    for place, rows in enumerate(dataset.episodes()):
        values = np.unique(registers[rows][on[rows]], axis=0)
        if len(values) > 1 or not ((values > 0) & (values < np.inf)).all():
            known = ", ".join(f"{value:g}" for value in np.unique(values))
            raise DatasetInvalid(
                f"{P_GAIN_COLUMN} of episode {dataset.episode_numbers[place]} of {name} is {known}; one gain above 0 "
                "for the whole episode is needed: record each gain in episodes of its own."
            )
        if len(values):
            gains[place] = values[0]
    return gains
