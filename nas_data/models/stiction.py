"""Stiction in φ: a joint stands still while its corrected displacement is below a threshold.

With the simulated next state q̂, v̂, the outputs φ of the network and a threshold τ ≥ 0 for each joint,

    u = q̂ + φ_q − q,    g = max(0, 1 − τ / |u|),    next q = q + g u,    next v = g (v̂ + φ_v).

Small corrections at rest then have no effect, and cannot accumulate over many steps. In motion, where |u| is large
against τ, φ corrects the source as without a threshold.
"""

from typing import TypeVar

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

CLOSED = -3.0  # output of the network is relative to it: softplus(−3) = 0.05 of the scale, a low threshold at first
LEAST = 1e-9  # [rad; m] least displacement, against division by zero

Array = TypeVar("Array", np.ndarray, Tensor)


def compute_share(displacement: Array, threshold: Array) -> Array:
    """Return the share g of a displacement (…, n) by which a joint moves, from 0 at the threshold (…, n) to 1."""
    return (1 - threshold / (abs(displacement) + LEAST)).clip(0, None)


def hold_below_threshold(changes: Tensor, outputs: Tensor, scale: Tensor, states: Tensor, predicted: Tensor) -> Tensor:
    """Return the changes of a source's prediction with which joints below their thresholds stand still.

    Args:
        changes: Changes φ without stiction, positions [rad; m] then velocities, shape (…, 2n).
        outputs: The network's outputs for the thresholds, shape (…, n).
        scale: Unit of the thresholds [rad; m], shape (n,).
        states: Positions then velocities, shape (…, 2n).
        predicted: Simulated next states, shape (…, 2n).
    """
    n = outputs.shape[-1]
    corrected = predicted + changes
    displacement = corrected[..., :n] - states[..., :n]
    share = compute_share(displacement, scale * functional.softplus(outputs + CLOSED))
    # near the threshold the slope of the share is 1 / τ, with which gradients of velocities would explode
    after = torch.cat([states[..., :n] + share * displacement, share.detach() * corrected[..., n:]], dim=-1)
    return after - predicted


def hold_in_place(outputs: np.ndarray, scale: np.ndarray, states: np.ndarray, predicted: np.ndarray) -> np.ndarray:
    """Do as `hold_below_threshold` in inference, and return the changes, shape (B, 2n).

    Args:
        outputs: Changes φ, then the network's outputs for the thresholds, shape (B, 3n).
        scale: Unit of the thresholds [rad; m], shape (n,).
        states: Positions then velocities, shape (B, 2n).
        predicted: Simulated next states, shape (B, 2n).
    """
    n = len(scale)
    corrected = predicted + outputs[:, : 2 * n]
    displacement = corrected[:, :n] - states[:, :n]
    share = compute_share(displacement, scale * np.logaddexp(0, outputs[:, 2 * n :] + CLOSED))
    corrected[:, :n] = states[:, :n] + share * displacement
    corrected[:, n:] *= share
    return corrected - predicted
