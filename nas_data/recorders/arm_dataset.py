"""Conversion of an arm's episodes to a dataset; late and repeated readings are flagged."""

from collections.abc import Collection, Sequence

import numpy as np

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import (
    ACTION,
    NEXT_STATE,
    STATE,
    TIME,
    Feature,
    make_position_feature,
    make_state_feature,
    make_time_feature,
)
from nas_data.dataset.supply_voltage import VOLTAGE
from nas_data.recorders.arm_motion import ArmEpisode

LOAD = "nas.load"
TEMPERATURE = "nas.temperature"
LATE = "nas.late"
REPEATED = "nas.repeated"


def to_dataset(
    episode: ArmEpisode, joints: Sequence[str], rate: float, task: str, robot: str, slides: Collection[str] = ()
) -> Dataset:
    """Return one episode as a dataset.

    Args:
        episode: Readings and commands.
        joints: Names of the arm's joints.
        rate: Control rate [Hz].
        task: Name of the task.
        robot: Type of the arm.
        slides: Names of the slide joints.
    """
    states = np.array([np.concatenate([reading.positions, reading.velocities]) for reading in episode.readings])
    times = np.array([reading.time for reading in episode.readings])
    loads = np.array([reading.loads for reading in episode.readings])
    columns = {
        STATE: states[:-1],
        ACTION: episode.active_commands(),
        NEXT_STATE: states[1:],
        TIME: (times[:-1] - times[0])[:, None],
        LOAD: loads[:-1],
        VOLTAGE: np.array(episode.voltages),
        TEMPERATURE: np.array(episode.temperatures),
        LATE: episode.late(1 / rate)[:-1, None],
        REPEATED: episode.repeated()[:-1, None],
    }
    features = make_arm_features(joints, slides)
    return Dataset(
        features=features,
        columns={key: column.astype(features[key].dtype) for key, column in columns.items()},
        lengths=np.array([len(episode.commands)]),
        fps=rate,
        robot_type=robot,
        tasks=(task,),
    )


def make_arm_features(joints: Sequence[str], slides: Collection[str] = ()) -> dict[str, Feature]:
    """Return the features of an arm's dataset."""
    return {
        STATE: make_state_feature(joints, slides),
        ACTION: make_position_feature(joints, slides),
        NEXT_STATE: make_state_feature(joints, slides),
        TIME: make_time_feature(),
        LOAD: _make_joint_feature(joints, "load", "1"),
        VOLTAGE: _make_joint_feature(joints, "voltage", "V"),
        TEMPERATURE: _make_joint_feature(joints, "temperature", "°C"),
        LATE: Feature(names=("late",), units=("1",)),
        REPEATED: Feature(names=("repeated",), units=("1",)),
    }


def _make_joint_feature(joints: Sequence[str], what: str, unit: str) -> Feature:
    return Feature(names=tuple(f"{name}.{what}" for name in joints), units=(unit,) * len(joints))
