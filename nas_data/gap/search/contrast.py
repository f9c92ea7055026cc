"""Contrast with a recording without the change to be named: what explains that recording, too, is no change."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from nas_data.effects.base import Effect
from nas_data.errors import ModelFileError
from nas_data.gap.search.objective import FitTask
from nas_data.gap.search.parameters import FreeParameters


@dataclass(frozen=True)
class Contrast:
    """Episodes without the change, with the model that describes them.

    Attributes:
        task: These episodes, with the usual errors of the model.
        misfits: Misfit of the model as given, by joint [nats], shape (n,).
    """

    task: FitTask
    misfits: np.ndarray
    _gains: dict[Effect, float] = field(default_factory=dict, compare=False)

    @classmethod
    def of(cls, task: FitTask) -> "Contrast":
        """Return the contrast with some episodes; initial states are estimated once, with the model as given."""
        task = task.reestimate(FreeParameters((), ()), np.zeros(0))
        return cls(task, task.misfits(task.roll_out(task.evidence, (), {})).sum(axis=0))

    def measure_gain(self, effects: Sequence[Effect], observations: float) -> float:
        """Return what each effect alone gains here, summed over effects and the joints in which it gains [nats].

        Args:
            effects: Effects of a hypothesis.
            observations: Number of observations that the gain is scaled to.
        """
        return sum(map(self._gain, effects)) * observations / float(self.task.observations.sum())

    def _gain(self, effect: Effect) -> float:
        if effect not in self._gains:
            try:
                predicted = self.task.roll_out(self.task.evidence, (effect,), {})
            except ModelFileError:
                return 0.0
            gains = self.misfits - self.task.misfits(predicted).sum(axis=0)
            self._gains[effect] = float(np.maximum(gains, 0.0).sum())
        return self._gains[effect]
