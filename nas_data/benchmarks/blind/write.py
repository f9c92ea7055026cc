"""Write a case as a folder: dataset and nominal model to hand over, and the sealed answer."""

import json
from pathlib import Path

import numpy as np

from nas_data.benchmarks.blind.case import Case, Episodes
from nas_data.benchmarks.blind.plants.constants import Constants
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import (
    ACTION,
    NEXT_STATE,
    STATE,
    TIME,
    make_effort_feature,
    make_position_feature,
    make_state_feature,
    make_time_feature,
)
from nas_data.dataset.provenance import Provenance
from nas_data.dataset.transitions import estimate_velocities
from nas_data.dataset.write import write
from nas_data.typed_json import as_object

DATASET, NOMINAL, ANSWER, FRESH = "dataset", "nominal.xml", "answer.json", "fresh.npz"


def write_case(case: Case, folder: Path) -> None:
    """Write a case's folder.

    `dataset/` and `nominal.xml` are given to a workflow; `answer.json` and `fresh.npz` serve to grade it.

    Raises:
        OutputExists: the folder holds a dataset already.
    """
    folder.mkdir(parents=True, exist_ok=True)
    write(to_dataset(case), folder / DATASET, make_provenance(case))
    (folder / NOMINAL).write_text(case.arm.xml, encoding="utf-8")
    fresh = case.fresh
    kept = {name: getattr(fresh, name) for name in ("commands", "positions", "readings", "poses", "starts")}
    np.savez_compressed(folder / FRESH, **kept, rate=case.conditions.rate)
    (folder / ANSWER).write_text(json.dumps(as_object(case.answer()), indent=1), encoding="utf-8")


def make_provenance(case: Case) -> Provenance:
    """Return the dataset's provenance without a trace of the answer: no seed, no plant, no effect."""
    sensor = case.conditions.sensor
    return Provenance(
        how="simulated",
        robot=case.arm.name,
        target={"name": case.arm.name, "quantum": sensor.quantum, "noise": sensor.noise},
        signal={"excitation": case.conditions.signal},
        contiguous=True,
        notes="Blind benchmark: the target is not described.",
        packages={},
    )


def to_dataset(case: Case) -> Dataset:
    """Return the recorded episodes as a dataset."""
    joints, episodes, rate = case.arm.joints, case.recorded, case.conditions.rate
    count, steps, n = episodes.commands.shape
    states, command = (
        compute_measured_states(episodes, rate),
        make_effort_feature if case.conditions.pieces else make_position_feature,
    )
    columns: dict[str, np.ndarray] = {
        STATE: states[:, :-1].reshape(-1, 2 * n).astype(np.float32),
        ACTION: episodes.commands.reshape(-1, n).astype(np.float32),
        NEXT_STATE: states[:, 1:].reshape(-1, 2 * n).astype(np.float32),
        TIME: np.tile(np.arange(steps) / rate, count)[:, None],
    }
    sliding = Constants.of(case.arm.model()).sliding
    slides = [joint for joint, slide in zip(joints, sliding, strict=True) if slide]
    features = {
        STATE: make_state_feature(joints, slides),
        ACTION: command(joints, slides),
        NEXT_STATE: make_state_feature(joints, slides),
        TIME: make_time_feature(),
    }
    return Dataset(
        features=features,
        columns=columns,
        lengths=np.full(count, steps),
        fps=rate,
        robot_type=case.arm.name,
        tasks=(case.conditions.signal,) * count,
    )


def compute_measured_states(episodes: Episodes, rate: float) -> np.ndarray:
    """Return readings and speeds (E, T + 1, 2n) [rad, rad/s].

    Speeds that were not measured are backward differences, zero at the start of an episode that begins at rest. Those
    of episodes that begin in motion are estimated as in `nas import`.
    """
    speeds = episodes.speeds
    if speeds is None and episodes.start_speeds is not None:
        speeds = np.stack([estimate_velocities(readings, rate) for readings in episodes.readings])
    elif speeds is None:
        speeds = np.diff(episodes.readings, axis=1, prepend=episodes.readings[:, :1]) * rate
    return np.concatenate([episodes.readings, speeds], axis=2)
