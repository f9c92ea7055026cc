"""What is known before any gradient: normalisation from the training episodes and the best linear shortcut."""

import math
from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor

from nas_data.models.episodes import Episode
from nas_data.models.jacobians import command_slopes
from nas_data.models.lstm import DynamicsModel
from nas_data.simulators.base import Simulator

CONSTANT = 1e-6  # standard deviations below this are rounding
RIDGE = 1e-3  # relative to unit variance; keeps joints that never moved from growing large weights
LIMIT = 4 / 3  # of the largest command recorded: what a correction of commands may come to
HALVINGS = 8  # of a shortcut that diverges in closed loop, before it is given up


def prepare(model: DynamicsModel, transitions: Episode, simulator: Simulator | None = None) -> None:
    """Set the normalisation, and the shortcut where the model has one, from training transitions.

    Args:
        model: Untrained model; changed in place.
        transitions: All transitions of the training episodes, shape (N, …).
        simulator: Source; needed where commands are corrected.
    """
    inputs = model.raw_inputs(transitions.states, transitions.commands, transitions.predicted)
    if model.corrects == "command":
        assert simulator is not None
        largest = transitions.commands.abs().amax(0).clamp_min(CONSTANT)
        model.get_buffer("limit").copy_(LIMIT * largest)
        outputs = missing_commands(simulator, transitions).clamp(-largest, largest)
    else:
        outputs = transitions.targets - (transitions.predicted if model.kind == "delta" else transitions.states)
    inputs, outputs = model.with_images(inputs, outputs)
    # An output that never changed is predicted as constant; an input that never changed passes as it is.
    for name, values, constant in (("input", inputs, 1.0), ("output", outputs, CONSTANT)):
        model.get_buffer(f"{name}_mean").copy_(values.mean(0))
        model.get_buffer(f"{name}_std").copy_(standard_deviations(values, constant))
    if model.shortcut is not None:
        weight, bias = ridge(model.inputs.normalise(inputs), model.outputs.normalise(outputs))
        with torch.no_grad():
            model.shortcut.weight.copy_(weight)
            model.shortcut.bias.copy_(bias)
            model.outer.weight.mul_(0.1)  # start near the linear solution, and let the LSTM grow from there
            model.outer.bias.zero_()


def missing_commands(simulator: Simulator, transitions: Episode) -> Tensor:
    """Return by how much commands would have to differ for the source to move as was measured, shape (N, n).

    It is the least squares of each transition for itself, states in their spreads, by the source's slope.
    """
    states, commands, predicted, targets, objects = (
        getattr(transitions, name).double().numpy()
        for name in ("states", "commands", "predicted", "targets", "objects")
    )
    scenes = np.concatenate([states, objects], axis=1)
    fresh = simulator.predict(scenes, commands)[:, : predicted.shape[1]] if simulator.remembers else predicted
    slopes = command_slopes(simulator, scenes, commands, fresh)
    scale = 1 / np.maximum(states.std(axis=0), CONSTANT)
    missing = np.linalg.pinv(slopes * scale[:, None]) @ ((targets - predicted) * scale)[:, :, None]
    return torch.from_numpy(missing[:, :, 0]).float()


def soften(model: DynamicsModel, error: Callable[[], float]) -> tuple[float, float]:
    """Halve a shortcut that diverges in closed loop until its rollouts stay bounded and beat those without it.

    The best fit of single steps may be unstable when it reads its own states: on short or noisy data it is.

    Args:
        model: Model with a shortcut; changed in place.
        error: Returns the error of the model's rollouts [rad]; infinite where they diverge.

    Returns:
        The share of the shortcut that is kept, and the error with it.
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
        found = with_share(share)
        if math.isfinite(found) and found <= without:
            return share, found
    return 0.0, with_share(0.0)


def standard_deviations(values: Tensor, constant: float) -> Tensor:
    """Return standard deviations, those of constant components replaced by a number that divides harmlessly."""
    deviation = values.std(0, correction=0)
    return torch.where(deviation > CONSTANT, deviation, torch.full_like(deviation, constant))


def ridge(inputs: Tensor, outputs: Tensor) -> tuple[Tensor, Tensor]:
    """Fit outputs ≈ inputs @ weight.T + bias by ridge regression in float64.

    Returns:
        Weight (outputs, inputs) and bias (outputs,), float32.
    """
    design = torch.cat([inputs, torch.ones(len(inputs), 1)], dim=1).double()
    gram = design.T @ design + RIDGE * len(inputs) * torch.eye(design.shape[1], dtype=torch.float64)
    solution = torch.linalg.solve(gram, design.T @ outputs.double()).float()
    return solution[:-1].T, solution[-1]
