"""Definition of a late row of a recording, for recorders and audits."""

import numpy as np

LATE = 0.3  # share of a control period; a later reading does not belong to its control step


def find_late_readings(delays: np.ndarray, period: float) -> np.ndarray:
    """Return a mask of the late readings, shape (T,).

    Args:
        delays: Delay of each reading [s], shape (T,).
        period: Control period [s].
    """
    return delays > LATE * period
