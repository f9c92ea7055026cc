"""Progress of a sweep, and its remaining time."""

from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from nas_data.policies.watching import spoken
from nas_data.studies.ablation.results import error, unit_of
from nas_data.studies.ablation.trial import Config, Record


class SweepProgress:
    """Reports results as they arrive, with the remaining time."""

    def __init__(self, waiting: Sequence[Config], workers: int, total: int) -> None:
        """Start counting.

        Args:
            waiting: Trials to run.
            workers: Number of parallel trials.
            total: Number of trials of the sweep, finished ones included.
        """
        self.waiting = list(waiting)
        self.workers = max(1, min(workers, len(waiting)))
        self.total = total
        self.took: dict[str, list[float]] = defaultdict(list)

    def begin(self, failed: int) -> str:
        """Report the number of trials to run."""
        before = self.total - len(self.waiting)
        known = f"{before} of {self.total} trials were done before" if before else f"{self.total} trials"
        again = f" ({failed} of them failed; --retry does them again)" if failed else ""
        return f"{known}{again}; {len(self.waiting)} to do with {self.workers} worker{'s' * (self.workers > 1)}"

    def tell(self, config: Config, record: Record) -> str:
        """Report a trial's result, the number of finished trials, and the remaining time."""
        self.waiting.remove(config)
        seconds = float(str(record["wall_seconds"]))
        self.took[config.kind].append(seconds)
        found = f"failed: {record['failed']}" if "failed" in record else format_error(record)
        left = f", about {spoken(self.left())} left" if self.waiting else ""
        head = f"{self.total - len(self.waiting)} of {self.total}: {config.kind}, {config.amount}, seed {config.seed}"
        return f"{head}: {found} ({seconds:.0f} s{left})"

    def left(self) -> float:
        """Return the remaining time [s], estimated from finished trials of each kind."""
        every = [seconds for took in self.took.values() for seconds in took]
        return sum(float(np.mean(self.took.get(c.kind) or every)) for c in self.waiting) / self.workers


def format_error(record: Record) -> str:
    """Return the errors of a trial's own predictor as text."""
    unit, (loop, step) = unit_of(record), (error(record, way) for way in ("open_loop", "one_step"))
    return f"open loop {unit.text(loop, 3) if np.isfinite(loop) else 'diverged'}, one step {unit.text(step, 4)}"
