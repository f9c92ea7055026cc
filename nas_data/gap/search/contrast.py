"""Contrast with a recording without the change to be named: what explains that recording, too, is no change."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from nas_data.effects.base import Effect
from nas_data.errors import ModelFileError
from nas_data.gap.search.objective import FitTask


@dataclass(frozen=True)
class Contrast:
    """Episodes without the change, with the model that describes them.

    Attributes:
        task: These episodes, settled, with the usual errors of the model.
    """

    task: FitTask
    _gains: dict[Effect, float] = field(default_factory=dict, compare=False)

    def measure_gain(self, effects: Sequence[Effect], observations: float) -> float:
        """Return what each effect alone gains here, summed over effects and the joints in which it gains [nats].

        Args:
            effects: Effects of a hypothesis.
            observations: Number of observations that the gain is scaled to.
        """
        return sum(map(self._gain, effects)) * observations / float(self.task.observations.sum())

    @cached_property
    def _given(self) -> np.ndarray:
        """Misfit of the model as given, by joint [nats], shape (n,)."""
        return self._measure_misfits(())

    def _measure_misfits(self, effects: tuple[Effect, ...]) -> np.ndarray:
        return self.task.misfits(self.task.roll_out(self.task.evidence, effects, {})).sum(axis=0)

    def _gain(self, effect: Effect) -> float:
        if effect not in self._gains:
            try:
                gains = self._given - self._measure_misfits((effect,))
            except ModelFileError:  # the model diverges
                gains = np.zeros(1)
            self._gains[effect] = float(np.maximum(gains, 0.0).sum())
        return self._gains[effect]
