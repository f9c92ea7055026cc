"""One update of a training: the learning rate of the hour, a loss, its gradient, a step."""

import torch

from nas_data.models.training import Training


class Descent:
    """The optimiser of a training.

    Attributes:
        optimiser: AdamW; without weight decay it is Adam.
    """

    def __init__(self, training: Training) -> None:
        """Begin with no step taken."""
        self.training = training
        self.optimiser = torch.optim.AdamW(
            training.model.parameters(), lr=1e-3, weight_decay=training.options.weight_decay
        )

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
        return float(loss.detach())

    def _rate(self, number: int) -> float:
        """Return the learning rate: constant, or half a cosine after a short rise."""
        phase = self.training.phase
        if not self.training.options.cosine:
            return phase.rate
        share = number / phase.updates
        warm = min(1.0, (number + 1) / 20)
        return phase.rate * warm * (0.5 + 0.5 * float(torch.cos(torch.tensor(share * torch.pi)))) + 1e-5
