"""Poppy Ergo Jr without the robot: record six simulated XL-320 servos through their own bus protocol."""

import numpy as np

import nas_data as nas
from nas_data.commands.record_ergojr import RecordErgojr


def main() -> None:
    """Record the virtual arm, look at what its servos report, and find the joint with play."""
    # `nas record ergojr` as a Python object; port="/dev/ttyUSB0" moves a real arm in the same way.
    done = RecordErgojr(
        port="virtual",
        effect=("backlash:joint=m3,half_width=0.06",),
        excitation="triangle:speed=1.5",
        episodes=3,
        seconds=3,
        lockstep=True,  # as fast as this machine can, not in real time
        name="ergojr_virtual",
    ).run()
    print(done.text)

    ds = nas.Dataset.load("datasets/ergojr_virtual")
    print(ds)
    table = ds.to_pandas()
    print("temperature [°C]", table["nas.temperature"].max().to_dict())

    # The arm's own model in open loop: it starts once an episode and then sees commands only.
    errors = nas.evaluate("ergojr", ds, plain_fit=False)
    for joint, error in errors.open_loop["source"].per_joint.items():
        print(f"{joint}: open-loop error {np.degrees(error):.2f}°")


if __name__ == "__main__":
    main()
