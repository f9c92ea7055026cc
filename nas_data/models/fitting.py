"""Initialisation of a model in closed form: normalisation and the linear shortcut."""

import math
from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from nas_data.models.episodes import Episode
from nas_data.models.jacobians import estimate_command_jacobians
from nas_data.models.lstm import DynamicsModel
from nas_data.simulators.base import Simulator

CONSTANT = 1e-6  # components with a smaller standard deviation count as constant
RIDGE = 1e-3  # ridge penalty relative to unit variance; prevents large weights for joints that never moved
LIMIT = 4 / 3  # largest correction of commands over the largest recorded command
HALVINGS = 8  # most halvings of a shortcut that diverges in closed loop


def prepare(model: DynamicsModel, transitions: Episode, simulator: Simulator | None = None) -> None:
    """Set normalisation and shortcut, if the model has one, from training transitions.

    Args:
        model: Untrained model; changed in place.
        transitions: All transitions of the training episodes, shape (N, …).
        simulator: Source; needed if the model corrects commands.
    """
    inputs = model.raw_inputs(transitions.states, transitions.commands, transitions.predicted)
    if model.corrects == "command":
        assert simulator is not None
        largest = transitions.commands.abs().amax(0).clamp_min(CONSTANT)
        model.get_buffer("limit").copy_(LIMIT * largest)
        outputs = solve_missing_commands(simulator, transitions).clamp(-largest, largest)
    else:
        outputs = transitions.targets - (transitions.predicted if model.kind == "delta" else transitions.states)
    inputs, outputs = model.add_mirror_images(inputs, outputs)
    # A constant output is predicted as constant; a constant input is not scaled.
    for name, values, constant in (("input", inputs, 1.0), ("output", outputs, CONSTANT)):
        model.get_buffer(f"{name}_mean").copy_(values.mean(0))
        model.get_buffer(f"{name}_std").copy_(compute_standard_deviations(values, constant))
    if model.stiction:
        n = len(model.joints)
        moves = (transitions.targets - transitions.states)[:, :n]
        model.get_buffer("threshold_scale").copy_(compute_standard_deviations(moves, CONSTANT))
    if model.shortcut is not None:
        weight, bias = fit_ridge(model.inputs.normalise(inputs), model.outputs.normalise(outputs))
        thresholds = model.shortcut.out_features - len(bias)  # they start without a linear part
        with torch.no_grad():
            model.shortcut.weight.copy_(functional.pad(weight, (0, 0, 0, thresholds)))
            model.shortcut.bias.copy_(functional.pad(bias, (0, thresholds)))
            model.outer.weight.mul_(0.1)  # training starts near the linear solution
            model.outer.bias.zero_()


def solve_missing_commands(simulator: Simulator, transitions: Episode) -> Tensor:
    """Return the changes of commands with which the source would reach the measured next states, shape (N, n).

    They are the least-squares solution of each transition, linearised at the recorded command. States are scaled by
    their standard deviations.
    """
    states, commands, predicted, targets, objects = (
        getattr(transitions, name).double().numpy()
        for name in ("states", "commands", "predicted", "targets", "objects")
    )
    scenes = np.concatenate([states, objects], axis=1)
    fresh = simulator.predict(scenes, commands)[:, : predicted.shape[1]] if simulator.remembers else predicted
    slopes = estimate_command_jacobians(simulator, scenes, commands, fresh)
    scale = 1 / np.maximum(states.std(axis=0), CONSTANT)
    missing = np.linalg.pinv(slopes * scale[:, None]) @ ((targets - predicted) * scale)[:, :, None]
    return torch.from_numpy(missing[:, :, 0]).float()


def shrink_shortcut(model: DynamicsModel, error: Callable[[], float]) -> tuple[float, float]:
    """Halve a shortcut that diverges in closed loop until its rollouts are bounded and better than without it.

    The best fit of single steps may be unstable in closed loop, in particular for short or noisy recordings.

    Args:
        model: Model with a shortcut; changed in place.
        error: Returns the error of the model's rollouts [rad]; infinite if they diverge.

    Returns:
        The remaining share of the shortcut, and the error with it.
    """
    assert model.shortcut is not None
    weight = model.shortcut.weight
    full = weight.detach().clone()

    def with_share(share: float) -> float:
        with torch.no_grad():
            weight.copy_(share * full)
        return error()

    without = with_share(0.0)
    for share in (0.5**halving for halving in range(1, HALVINGS + 1)):
        with_shortcut = with_share(share)
        if math.isfinite(with_shortcut) and with_shortcut <= without:
            return share, with_shortcut
    return 0.0, with_share(0.0)


def compute_standard_deviations(values: Tensor, constant: float) -> Tensor:
    """Return standard deviations (d,) of values (N, d); constant components get the value `constant`."""
    deviation = values.std(0, correction=0)
    return torch.where(deviation > CONSTANT, deviation, torch.full_like(deviation, constant))


def fit_ridge(inputs: Tensor, outputs: Tensor) -> tuple[Tensor, Tensor]:
    """Fit outputs ≈ inputs @ weight.T + bias by ridge regression in float64.

    Returns:
        Weight, shape (outputs, inputs), and bias, shape (outputs,), float32.
    """
    design = torch.cat([inputs, torch.ones(len(inputs), 1)], dim=1).double()
    gram = design.T @ design + RIDGE * len(inputs) * torch.eye(design.shape[1], dtype=torch.float64)
    solution = torch.linalg.solve(gram, design.T @ outputs.double()).float()
    return solution[:-1].T, solution[-1]
