"""Supply voltage that servos measured during a recording."""

from collections.abc import Mapping

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.torque_off import find_torque_on

VOLTAGE = "nas.voltage"


def read_supply_voltages(dataset: Dataset) -> Mapping[str, float]:
    """Return the mean voltage of each joint's servo while the torque is on, to 0.01 V; empty without readings."""
    if VOLTAGE not in dataset.columns:
        return {}
    volts = dataset.columns[VOLTAGE][find_torque_on(dataset)].astype(float)
    if volts.shape[1] != len(dataset.joints):
        return {}
    known = zip(dataset.joints, volts.T, strict=True)
    return {joint: round(float(own[own > 0].mean()), 2) for joint, own in known if (own > 0).any()}
