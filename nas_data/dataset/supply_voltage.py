"""Supply voltage that servos measured during a recording."""

from collections.abc import Mapping

import numpy as np

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.torque_off import find_torque_on

VOLTAGE = "nas.voltage"
VOLTS = {"V": 1.0, "mV": 1e-3}  # size of the units in which it is used [V]


def read_supply_voltages(dataset: Dataset) -> Mapping[str, float]:
    """Return the mean voltage of each joint's servo while the torque is on, to 0.01 V.

    It is empty without readings above 0 in volts or millivolts. Readings may be one for all servos, or one for each.
    """
    if VOLTAGE not in dataset.columns:
        return {}
    units, n = dataset.features[VOLTAGE].units, len(dataset.joints)
    readings = dataset.columns[VOLTAGE][find_torque_on(dataset)].astype(float)
    if readings.shape[1] not in (1, n) or not set(units) <= set(VOLTS) or not units:
        return {}
    volts = np.broadcast_to(readings * [VOLTS[unit] for unit in units], (len(readings), n))
    known = zip(dataset.joints, volts.T, strict=True)
    return {joint: round(float(own[own > 0].mean()), 2) for joint, own in known if (own > 0).any()}
