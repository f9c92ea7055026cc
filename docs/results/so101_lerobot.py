"""The SO-101 recordings as LeRobot keeps them, in degrees: they must give the errors that docs/so101.md has.

    python docs/results/so101_lerobot.py sage_so101 runs/so101_lerobot

LeRobot's own writer writes the motions in degrees, the gripper in 0 … 100, as `lerobot-record` would. What is imported
from there and what is imported from the radians of the .npz files are judged by the same command. Printed are the
open-loop errors from degrees, the page's beside them, and by how much degrees and radians differ.
"""

import contextlib
import io
import json
import re
import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import tyro

from nas_data.cli import main as nas
from nas_data.dataset.read import read
from nas_data.dataset.versions import resolve

PAGE = Path(__file__).parents[1] / "so101.md"
MODEL = "model/so101_new_calib_nomesh.xml"
JOINTS = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")
FPS = 50  # [Hz] as a user says it to lerobot-record, which takes whole numbers
RATE = 49.85  # [Hz] at which the rows were read
PREDICTORS = ("hold", "command", "source")
Table = Mapping[str, Mapping[str, float]]  # error [°] by motion and predictor


def in_lerobot_units(values: np.ndarray) -> np.ndarray:
    """Return the recordings' numbers [rad; gripper 0 … 1] as LeRobot has them [°; gripper 0 … 100], shape (N, 6)."""
    return np.hstack([np.degrees(values[:, :5]), 100 * values[:, 5:]]).astype(np.float32)


def write_degrees(recordings: Path, root: Path) -> None:
    """Write the motions as episodes of a dataset that LeRobot makes."""
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    vector = {"dtype": "float32", "shape": (len(JOINTS),), "names": [f"{joint}.pos" for joint in JOINTS]}
    features = {"observation.state": vector, "action": dict(vector)}
    written = LeRobotDataset.create(
        "nas/so101", fps=FPS, features=features, root=root, robot_type="so101_follower", use_videos=False
    )
    for path in sorted(recordings.glob("*.npz")):
        log = np.load(path)
        assert tuple(log["joint_names"]) == JOINTS
        rows = zip(in_lerobot_units(log["position"]), in_lerobot_units(log["action"]), strict=True)
        for position, command in rows:
            written.add_frame({"observation.state": position, "action": command, "task": path.stem})
        written.save_episode()
    written.finalize()


def judge(model: Path, dataset: Path) -> dict[str, Table]:
    """Return the errors of one step and of whole motions, as `nas evaluate` prints them."""
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        assert nas(["evaluate", str(model), str(dataset), "--json"]) == 0
    answer, motions = json.loads(said.getvalue()), read(resolve(dataset)).tasks
    return {
        kind: {
            motion: {name: float(np.degrees(answer[kind][name]["per_episode"][episode])) for name in PREDICTORS}
            for episode, motion in enumerate(motions)
        }
        for kind in ("one_step", "open_loop")
    }


def page_table() -> Table:
    """Return what the table of docs/so101.md says of the held-out motions."""
    row = re.compile(r"^\| `(\w+)` \| ([\d.]+) \| ([\d.]+) \| \S+ \| \S+ \|$", re.MULTILINE)
    found = row.findall(PAGE.read_text(encoding="utf-8"))
    assert found, "the page has this table"
    return {motion: {"command": float(command), "source": float(source)} for motion, command, source in found}


def apart(one: Table, other: Table) -> float:
    """Return the largest difference of two tables [°]."""
    return max(abs(one[motion][name] - other[motion][name]) for motion in one for name in PREDICTORS)


def judge_both(recordings: Path, out: Path) -> list[dict[str, Table]]:
    """Import the motions from LeRobot's degrees and from radians into a folder, and return the errors of either."""
    write_degrees(recordings, out / "degrees")
    logs = sorted(str(path) for path in recordings.glob("*.npz"))
    said = ["--map", "so101_lerobot", "--rate", str(RATE)]
    assert nas(["import", str(out / "degrees"), *said, "--out", str(out / "from_degrees")]) == 0
    assert nas(["import", *logs, "--map", "so101_npz", "--out", str(out / "from_radians")]) == 0
    return [judge(recordings / MODEL, out / name) for name in ("from_degrees", "from_radians")]


def main(recordings: tyro.conf.Positional[Path], out: tyro.conf.Positional[Path]) -> None:
    """Write, import, judge and compare.

    Args:
        recordings: Folder of the .npz files, with the arm's model in `model/`.
        out: Folder for the datasets; must not exist.
    """
    degrees, radians = judge_both(recordings, out)
    found, table = degrees["open_loop"], page_table()
    print("\nopen loop [°]".ljust(22), *(name.rjust(10) for name in PREDICTORS), "page: command, source".rjust(26))
    for motion, errors in found.items():
        beside = "  ".join(f"{value:.2f}" for value in table.get(motion, {}).values())
        print(motion.ljust(21), *(f"{errors[name]:10.4f}" for name in PREDICTORS), beside.rjust(26))
    means = {name: np.mean([found[motion][name] for motion in table]) for name in PREDICTORS}
    print("mean of the page's".ljust(21), *(f"{means[name]:10.4f}" for name in PREDICTORS))
    for kind, errors in degrees.items():
        print(f"{kind}: from degrees and from radians differ by at most {apart(errors, radians[kind]):.1e}°")
    told = [(motion, name, value) for motion, row in table.items() for name, value in row.items()]
    other = [f"{motion}: {name}" for motion, name, value in told if f"{found[motion][name]:.2f}" != f"{value:.2f}"]
    sys.exit(f"other than on the page: {', '.join(other)}" if other else None)


if __name__ == "__main__":
    tyro.cli(main)
