"""The log that `examples/own_arm_from_csv.py` reads: `python tests/support/example_log.py` writes it anew."""

from pathlib import Path

import numpy as np

import nas_data as nas

EXAMPLES = Path(__file__).parents[2] / "examples"
HIDDEN = "backlash:joint=elbow,half_width=0.04"


def write_log(path: Path) -> None:
    """Record the arm with play that its model lacks, and write positions and goals in degrees."""
    ds = nas.record(
        EXAMPLES / "own_arm.xml",
        effects=[HIDDEN],
        excitation="multisine",
        rate=50,
        episodes=6,
        seconds=2.5,
        noise=0.0005,
        seed=1,
    )
    n, episode = len(ds.joints), np.repeat(np.arange(ds.n_episodes), ds.lengths)
    table = np.column_stack([episode, np.degrees(ds.states[:, :n]), np.degrees(ds.commands)])
    header = ",".join(["episode", *ds.joints, *(f"{joint}_goal" for joint in ds.joints)])
    np.savetxt(path, table, fmt=["%d", *["%.3f"] * 2 * n], delimiter=",", header=header, comments="")


if __name__ == "__main__":
    write_log(EXAMPLES / "own_arm.csv")
