"""Cross products and rotations of batches, faster for small arrays than NumPy's general functions."""

import numpy as np


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the cross product over the last axis, shapes broadcast."""
    result = np.empty(np.broadcast_shapes(a.shape, b.shape))
    result[..., 0] = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    result[..., 1] = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    result[..., 2] = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return result


def clip_symmetric(values: np.ndarray, limit: np.ndarray | float) -> np.ndarray:
    """Clip values to ± a limit; `np.clip` takes four times as long for small arrays."""
    return np.asarray(np.minimum(np.maximum(values, -limit), limit))


def shift(values: np.ndarray, joints: int) -> np.ndarray:
    """Move values (B, n) by one joint towards the tip (1) or the base (−1); zeros come in."""
    moved = np.zeros_like(values)
    if joints > 0:
        moved[:, 1:] = values[:, :-1]
    else:
        moved[:, :-1] = values[:, 1:]
    return moved


def skew(axis: np.ndarray) -> np.ndarray:
    """Return the matrix K with K @ b = axis × b, shape (…, 3, 3)."""
    return np.stack([cross(axis, unit) for unit in np.eye(3)], axis=-1)


def convert_quaternion(quaternion: np.ndarray) -> np.ndarray:
    """Return the rotation matrix of a unit quaternion (w, x, y, z)."""
    vector = skew(np.asarray(quaternion[1:], float))
    return np.asarray(np.eye(3) + 2 * quaternion[0] * vector + 2 * vector @ vector)


def make_rotation(axis: np.ndarray, angle: float) -> np.ndarray:
    """Return the rotation matrix (3, 3) for an angle [rad] about a unit axis (Rodrigues)."""
    turn = skew(np.asarray(axis, float))
    return np.asarray(np.eye(3) + np.sin(angle) * turn + (1 - np.cos(angle)) * turn @ turn)


def from_here_on(values: np.ndarray) -> np.ndarray:
    """Sum over each link and all beyond it: reverse cumulative sum over axis 1."""
    return np.asarray(values[:, ::-1].cumsum(axis=1)[:, ::-1])
