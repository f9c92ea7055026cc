"""Your own arm: make a report that names what the model lacks from a CSV log and an MJCF model.

Without arguments it uses the log and the model in its folder. For yours: own_arm_from_csv.py LOG.csv MODEL.xml
The log has the columns episode, <joint> and <joint>_goal (the command), in degrees, at 50 rows per second.
"""

import sys
from pathlib import Path

import numpy as np
import pandas as pd

import nas_data as nas

HERE = Path(__file__).parent
RATE = 50  # [Hz]


def main(log: Path, model: Path) -> None:
    """Read the log, ask what is missing, and write the report."""
    table = pd.read_csv(log)
    joints = [name.removesuffix("_goal") for name in table.columns if name.endswith("_goal")]
    episodes = [rows for _, rows in table.groupby("episode")]
    ds = nas.Dataset.from_arrays(
        positions=[np.radians(rows[joints].to_numpy()) for rows in episodes],
        commands=[np.radians(rows[[f"{joint}_goal" for joint in joints]].to_numpy()) for rows in episodes],
        rate=RATE,
        joints=joints,
    )
    print(ds)

    # One step: where does the model go wrong?
    paired = nas.pair(ds, model)
    error = np.degrees(paired.sim_states - paired.next_states)[:, : len(joints)]
    for joint, column in zip(joints, error.T, strict=True):
        print(f"{joint}: the model's next position is off by {np.sqrt(np.mean(column**2)):.3f}° (RMS)")

    # What would explain it? This takes a minute.
    report = nas.identify(ds, model)
    print(report)
    folder = Path("runs/own_arm")
    report.save(folder)
    print(f"Open {folder / 'report.html'}; the corrected model is {folder / 'model.xml'}.")


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:] or [HERE / "own_arm.csv", HERE / "own_arm.xml"]))
