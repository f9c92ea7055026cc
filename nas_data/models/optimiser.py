"""The optimiser of a training: learning rate, gradient clipping and averaged weights."""

from collections.abc import Callable
from typing import cast

import torch
from torch import Tensor
from torch.optim.swa_utils import AveragedModel

from nas_data.models.lstm import DynamicsModel
from nas_data.models.training import ModelTraining

Tensors = tuple[Tensor, ...] | list[Tensor]


class Optimiser:
    """The optimiser of a training.

    Attributes:
        adamw: AdamW; without weight decay it equals Adam.
        average: Running mean of the weights; None if the options ask for none.
    """

    def __init__(self, training: ModelTraining) -> None:
        """Create the optimiser before its first step."""
        self.training = training
        self.adamw = torch.optim.AdamW(training.model.parameters(), lr=1e-3, weight_decay=training.options.weight_decay)
        decay = training.options.average
        self.average = AveragedModel(training.model, multi_avg_fn=make_running_mean(decay)) if decay else None

    @property
    def model(self) -> DynamicsModel:
        """The model to validate and store; after the first step, with averaged weights if the options ask for them."""
        if self.average is None or not self.average.n_averaged:
            return self.training.model
        return cast("DynamicsModel", self.average.module)

    def update(self, number: int) -> float:
        """Make one update and return the loss before it; an update with a gradient that is not finite is skipped."""
        for group in self.adamw.param_groups:
            group["lr"] = self._rate(number)
        loss = self.training.phase.loss(number)
        self.adamw.zero_grad()
        loss.backward()
        limit = self.training.options.clip or float("inf")
        norm = torch.nn.utils.clip_grad_norm_(self.training.model.parameters(), limit)
        if torch.isfinite(norm):
            self.adamw.step()
        if self.average is not None:
            self.average.update_parameters(self.training.model)
        return float(loss.detach())

    def _rate(self, number: int) -> float:
        """Return the learning rate: constant, or a cosine decay after a linear warm-up of 20 updates."""
        phase = self.training.phase
        if not self.training.options.cosine:
            return phase.rate
        share = number / phase.updates
        warm = min(1.0, (number + 1) / 20)
        return phase.rate * warm * (0.5 + 0.5 * float(torch.cos(torch.tensor(share * torch.pi)))) + 1e-5


def make_running_mean(decay: float) -> Callable[[Tensors, Tensors, Tensor | int], None]:
    """Return the update function of averaged weights: an exponential mean, with less decay in the first updates."""

    @torch.no_grad()
    def move(averaged: Tensors, latest: Tensors, count: Tensor | int) -> None:
        kept = min(decay, (1 + int(count)) / (10 + int(count)))
        for mean, weight in zip(averaged, latest, strict=True):
            mean.lerp_(weight, 1 - kept)

    return move
