"""One update of a training: the learning rate of the hour, a loss, its gradient, a step."""

from collections.abc import Callable
from typing import cast

import torch
from torch import Tensor
from torch.optim.swa_utils import AveragedModel

from nas_data.models.lstm import DynamicsModel
from nas_data.models.training import ModelTraining

Tensors = tuple[Tensor, ...] | list[Tensor]


class Descent:
    """The optimiser of a training.

    Attributes:
        optimiser: AdamW; without weight decay it is Adam.
        average: Running mean of the weights; None where none is asked for.
    """

    def __init__(self, training: ModelTraining) -> None:
        """Begin with no step taken."""
        self.training = training
        self.optimiser = torch.optim.AdamW(
            training.model.parameters(), lr=1e-3, weight_decay=training.options.weight_decay
        )
        decay = training.options.average
        self.average = AveragedModel(training.model, multi_avg_fn=running_mean(decay)) if decay else None

    @property
    def model(self) -> DynamicsModel:
        """The model that is judged and kept: with the mean of its weights, once a step was taken."""
        if self.average is None or not self.average.n_averaged:
            return self.training.model
        return cast("DynamicsModel", self.average.module)

    def update(self, number: int) -> float:
        """Take the step of an update and return the loss before it; a step that is not finite is left out."""
        for group in self.optimiser.param_groups:
            group["lr"] = self._rate(number)
        loss = self.training.phase.loss(number)
        self.optimiser.zero_grad()
        loss.backward()
        limit = self.training.options.clip or float("inf")
        norm = torch.nn.utils.clip_grad_norm_(self.training.model.parameters(), limit)
        if torch.isfinite(norm):
            self.optimiser.step()
        if self.average is not None:
            self.average.update_parameters(self.training.model)
        return float(loss.detach())

    def _rate(self, number: int) -> float:
        """Return the learning rate: constant, or half a cosine after a short rise."""
        phase = self.training.phase
        if not self.training.options.cosine:
            return phase.rate
        share = number / phase.updates
        warm = min(1.0, (number + 1) / 20)
        return phase.rate * warm * (0.5 + 0.5 * float(torch.cos(torch.tensor(share * torch.pi)))) + 1e-5


def running_mean(decay: float) -> Callable[[Tensors, Tensors, Tensor | int], None]:
    """Return what moves averaged weights towards the latest ones: an exponential mean, a plain one at first."""

    @torch.no_grad()
    def move(averaged: Tensors, latest: Tensors, count: Tensor | int) -> None:
        kept = min(decay, (1 + int(count)) / (10 + int(count)))
        for mean, weight in zip(averaged, latest, strict=True):
            mean.lerp_(weight, 1 - kept)

    return move
