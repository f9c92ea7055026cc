"""Write the SO-101 recordings anew with a known change in them: late commands, or a joint that reads wrong."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import tyro

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.provenance import read_provenance
from nas_data.dataset.read import read
from nas_data.dataset.versions import resolve
from nas_data.dataset.write import write

LATE = 2  # samples by which the arm seems to hear each command later
OFF, JOINT = np.radians(2.0), "wrist_flex"  # [rad] by which a joint reads more than it did
POSITIONS = ("observation.state", "next.observation.state")


def late(dataset: Dataset) -> Dataset:
    """Return a dataset whose commands were given some samples earlier than the arm moved by them."""
    commands = dataset.columns["action"].copy()
    for rows in dataset.episodes():
        own = commands[rows].copy()
        commands[rows] = np.concatenate([own[LATE:], np.repeat(own[-1:], LATE, axis=0)])
    return replace(dataset, columns={**dataset.columns, "action": commands})


def off(dataset: Dataset) -> Dataset:
    """Return a dataset in which one joint reads more than it did."""
    joint = dataset.joints.index(JOINT)
    columns = dict(dataset.columns)
    for key in POSITIONS:
        columns[key] = columns[key].copy()
        columns[key][:, joint] += OFF
    return replace(dataset, columns=columns)


def main(datasets: tyro.conf.Positional[Path]) -> None:
    """Write both beside the recordings.

    Args:
        datasets: Folder of the dataset `so101`.
    """
    root = resolve(datasets / "so101")
    dataset, provenance = read(root), read_provenance(root)
    assert provenance, "nas import writes it"
    for name, changed in (("so101_late", late(dataset)), ("so101_off", off(dataset))):
        print(write(changed, datasets / name, provenance))


if __name__ == "__main__":
    tyro.cli(main)
