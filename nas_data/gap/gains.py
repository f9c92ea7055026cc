"""Position gains that differ between episodes, relative to the model's gain."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import POSITION, Feature
from nas_data.dataset.position_gains import P_GAIN_COLUMN, read_position_gains
from nas_data.errors import ModelFileError
from nas_data.robots.base import find_robot
from nas_data.simulators.register_kinds import P_GAIN
from nas_data.simulators.servo_registers import read_stated

RELATIVE_GAIN = "nas.gain"  # column in memory: register over the model's value


def with_relative_gains(dataset: Dataset, model: str | Path, name: str | Path) -> Dataset:
    """Add each episode's gain relative to the model's, from the registers of both.

    Args:
        dataset: Transitions; returned unchanged without registers, or if they are equal and the model states no value.
        model: Robot's name or model file.
        name: Name of the dataset in errors.

    Raises:
        ModelFileError: the gains of a joint differ and the model does not state its register.
        DatasetInvalid: a register is not a positive number, or changes within an episode.
    """
    if P_GAIN_COLUMN not in dataset.columns or not dataset.n_frames:
        return dataset
    registers, own = read_position_gains(dataset, name), read_model_registers(model, dataset.joints)
    unstated = np.isnan(own)
    check_equal_gains(registers[registers.any(axis=1)][:, unstated], model, name)
    if unstated.all():
        return dataset
    feature = Feature(tuple(joint + POSITION for joint in dataset.joints))
    ratios = np.where(unstated, 1.0, registers / own)
    return dataset.with_column(RELATIVE_GAIN, feature, np.repeat(ratios, dataset.lengths, axis=0))


def read_relative_gains(dataset: Dataset) -> np.ndarray:
    """Return the gain of each joint and episode relative to the model's, shape (E, n); 1 if unknown."""
    gains = np.ones((dataset.n_episodes, len(dataset.joints)))
    if RELATIVE_GAIN in dataset.columns:
        known = dataset.lengths > 0
        gains[known] = dataset.columns[RELATIVE_GAIN][dataset.starts[known]]
    return gains


def read_model_registers(model: str | Path, joints: Sequence[str]) -> np.ndarray:
    """Return the P registers that correspond to a model's gains, shape (n,); NaN where it states none.

    Raises:
        ModelFileError: the model cannot be read, or a value is not a positive number.
    """
    robot = find_robot(model)
    spec = robot.spec()
    return np.array([read_stated(spec, robot, P_GAIN, joint) for joint in joints], float)


def check_equal_gains(registers: np.ndarray, model: str | Path, name: str | Path) -> None:
    """Refuse gains that differ if the model does not state the register of its own."""
    values = np.unique(registers, axis=0)
    if len(values) > 1:
        known = ", ".join(f"{value:g}" for value in np.unique(values))
        raise ModelFileError(
            f"{name} was recorded at several position gains ({P_GAIN_COLUMN}: {known}), and {model} does not give the "
            f'one of its own gain: add <custom><numeric name="{P_GAIN}" data="…"/></custom> to the model.'
        )
