"""Learning curve of a training: best held-out loss over processor time."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

from nas_data.dataset.dataset import Dataset
from nas_data.models.optimiser import Optimiser
from nas_data.models.presets import TrainingOptions
from nas_data.models.threads import one_thread
from nas_data.models.training import ModelTraining


@dataclass(frozen=True)
class Point:
    """The end of an epoch.

    Attributes:
        cpu: Processor time since the start of the training [s], without validations.
        wall: Elapsed time [s], without validations.
        loss: Best one-step error on the held-out episodes so far, mean square in units of the target's spread.
    """

    cpu: float
    wall: float
    loss: float


Curve = tuple[Point, ...]


@one_thread()
def learn(dataset: Dataset, options: TrainingOptions, enough: Callable[[Point], bool]) -> Curve:
    """Train φ by teacher forcing, epoch by epoch.

    Args:
        dataset: Paired episodes.
        options: Options of the training.
        enough: Called after each epoch; the training stops if it returns True, or at the end of its schedule.

    Returns:
        One point per epoch, at least one. The first includes the time before the first epoch (normalisation and the
        closed-form fit of the shortcut).
    """
    clock = Stopwatch()
    training = ModelTraining("delta", dataset, options, device="cpu")
    descent, curve = Optimiser(training), list[Point]()
    for epoch in range(options.epochs):
        first = epoch * training.phase.per_validation
        for number in range(first, first + training.phase.per_validation):
            descent.update(number)
        clock.stop()
        best = min(training.validation_error(), curve[-1].loss if curve else math.inf)
        curve.append(Point(clock.cpu, clock.wall, best))
        if enough(curve[-1]):
            break
        clock.go()
    return tuple(curve)


def find_time_to_loss(curve: Curve, loss: float) -> tuple[float, float]:
    """Return the processor and elapsed time [s] at which a held-out loss was reached; infinite if never."""
    return next(((point.cpu, point.wall) for point in curve if point.loss <= loss), (math.inf, math.inf))


class Stopwatch:
    """Processor and elapsed time [s]."""

    def __init__(self) -> None:
        """Start at zero."""
        self.cpu = self.wall = 0.0
        self.go()

    def go(self) -> None:
        """Continue."""
        self._since = time.process_time(), time.perf_counter()

    def stop(self) -> None:
        """Stop; `cpu` and `wall` hold the time so far."""
        cpu, wall = self._since
        self.cpu += time.process_time() - cpu
        self.wall += time.perf_counter() - wall
