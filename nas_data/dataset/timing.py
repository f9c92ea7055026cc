"""When a row of a recording counts as late: one rule for those who record and for those who check."""

import numpy as np

LATE = 0.3  # share of a control period: beyond it a reading belongs to its moment no more than roughly


def late_readings(delays: np.ndarray, period: float) -> np.ndarray:
    """Return which readings came late.

    Args:
        delays: How long after its time each was made [s], shape (T,).
        period: Control period [s].
    """
    return delays > LATE * period
