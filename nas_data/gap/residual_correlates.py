"""Quantities with which an unexplained error correlates."""

from collections.abc import Collection, Mapping

import numpy as np

from nas_data.gap.episode_batch import EpisodeBatch
from nas_data.joint_units import compute_angle_scales

# [rad/s; for slides times the equivalent of a radian] above which a joint has a direction: a reading that flickers by
# 0.3° in 40 ms is slower
MOVING_SPEED = 0.25
BINS = 24  # bins of the position
NOTHING = "nothing"  # answer where no quantity explains more than chance


def find_residual_correlate(
    evidence: EpisodeBatch, errors: np.ndarray, joint: int, slides: Collection[str] = ()
) -> str:
    """Name the quantity that explains most of the variance of a joint's error.

    Args:
        evidence: Episodes.
        errors: Predicted minus measured positions [rad; m], shape (E, T, n).
        joint: Index of the joint.
        slides: Names of the slides.

    Returns:
        `position`, `speed`, `direction`, `acceleration`, `command`, `other joints` or `time`; `nothing` if none
        explains more than chance.
    """
    seen = evidence.mask[:, 2:-2].ravel()
    wanted = errors[:, 2:-2, joint].ravel()[seen]
    travel = np.ptp(evidence.measured[evidence.mask], axis=0)
    moving = MOVING_SPEED * float(compute_angle_scales(evidence.joints, slides, travel)[joint])
    found = list_regressors(evidence, joint, moving)
    shares = {name: compute_explained_variance(wanted, rows[seen]) for name, rows in found.items() if rows.shape[1]}
    best = max(shares, key=lambda name: shares[name])
    return best if shares[best] > 0 else NOTHING


def list_regressors(evidence: EpisodeBatch, joint: int, moving: float) -> Mapping[str, np.ndarray]:
    """Return the regressors of each quantity, shape (rows, columns); `moving` is the smallest speed [rad/s; m/s]."""
    q = evidence.measured
    speed = (q[:, 4:] - q[:, :-4]) / (4 * evidence.period)
    acceleration = (q[:, 4:] - 2 * q[:, 2:-2] + q[:, :-4]) / (2 * evidence.period) ** 2
    middle = q[:, 2:-2]
    others = [i for i in range(q.shape[2]) if i != joint]
    time = np.broadcast_to(np.arange(middle.shape[1])[None, :, None] * evidence.period, middle[..., :1].shape)
    positions = encode_position_bins(middle[..., joint])

    def flat(rows: np.ndarray) -> np.ndarray:
        return rows.reshape(rows.shape[0] * rows.shape[1], rows.shape[2])

    own = speed[..., [joint]]
    return {
        "position": positions,
        "speed": flat(np.concatenate([own, own * np.abs(own)], -1)),
        "direction": flat(np.sign(own) * (np.abs(own) > moving)),
        "acceleration": flat(acceleration[..., [joint]]),
        "command": flat((evidence.commands[:, 2:-2] - middle)[..., [joint]]),
        "other joints": flat(np.concatenate([speed[..., others], acceleration[..., others]], -1)),
        "time": flat(np.concatenate([time, time**2], -1)),
    }


def encode_position_bins(positions: np.ndarray) -> np.ndarray:
    """Return an indicator column for each bin of the position, for errors of any shape over it."""
    low, high = positions.min(), positions.max()
    bins = np.minimum((BINS * (positions.ravel() - low) / max(high - low, 1e-9)).astype(int), BINS - 1)
    return np.eye(BINS)[bins]


def compute_explained_variance(wanted: np.ndarray, columns: np.ndarray) -> float:
    """Return the share of variance that a linear fit explains, adjusted for the number of columns."""
    centred = wanted - wanted.mean()
    rows = np.concatenate([columns, np.ones((len(columns), 1))], axis=1)
    solved, *_ = np.linalg.lstsq(rows, centred, rcond=None)
    rest = centred - rows @ solved
    count = max(len(wanted) / 15, columns.shape[1] + 2)
    share = 1 - float(rest @ rest) / max(float(centred @ centred), 1e-18)
    return 1 - (1 - share) * (count - 1) / max(count - columns.shape[1] - 1, 1.0)
