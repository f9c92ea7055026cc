"""SO-101: learn what its model lacks, and judge the result on motions that were not learned from.

Without arguments it simulates a recording. With a path it takes yours:
    so101.py MY_RECORDING --map so101_lerobot    what lerobot-record wrote, in degrees
    so101.py MY_RECORDING                        a LeRobot dataset in radians
    so101.py LOGS/*.npz --map so101_npz          logs that a map describes
"""

import argparse
from pathlib import Path

import nas_data as nas
from nas_data.models.presets import preset

MODEL = "so101_follower"
# A stand-in for a real arm: softer servos and some friction.
EFFECTS = (
    "servo_stiffness:joint=shoulder_lift,factor=0.3",
    "servo_stiffness:joint=elbow_flex,factor=0.3",
    "coulomb_friction:joint=shoulder_lift,torque=0.1",
)


def main() -> None:
    """Get a recording, hold a quarter of it out, train φ, and print the errors."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="*", type=Path)
    parser.add_argument("--map", help="what the numbers in the logs mean")
    parser.add_argument("--model", default=MODEL)
    parser.add_argument("--updates", type=int, default=30, help="of the training; 400 for a good one")
    given = parser.parse_args()

    if given.map:
        ds = nas.import_logs(given.logs, map=given.map, cut=3)
    elif given.logs:
        ds = nas.Dataset.load(given.logs[0])
    else:
        ds = nas.record(MODEL, effects=EFFECTS, excitation="ramps", rate=50, episodes=40, seconds=3)
    print(ds)

    held_out = [episode for episode in range(ds.n_episodes) if episode % 4 == 3]
    learned_from = [episode for episode in range(ds.n_episodes) if episode % 4 != 3]

    # φ corrects the model: it learns measured minus simulated from pairs.
    paired = nas.pair(ds.select(learned_from), given.model)
    small = preset("few", hidden=32, frames=3200, updates=given.updates)
    phi = nas.train_delta(paired, preset=small, progress=print)
    print(phi)

    # Open loop: the model starts once an episode and then sees commands only.
    errors = nas.evaluate(phi, ds.select(held_out), model=given.model, plain_fit=False)
    print(errors)


if __name__ == "__main__":
    main()
