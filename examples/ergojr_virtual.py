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

    # The arm's own model, one control step from each measured state.
    paired = nas.pair(ds, model="ergojr")
    n = len(ds.joints)
    error = np.degrees(paired.sim_states - paired.next_states)[:, :n]
    for joint, column in zip(ds.joints, error.T, strict=True):
        print(f"{joint}: one-step error {np.sqrt(np.mean(column**2)):.3f}°")


if __name__ == "__main__":
    main()
