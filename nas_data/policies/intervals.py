"""How sure a median over seeds is, called what it is: few seeds have a range, only more have an interval of 95 %."""

from dataclasses import dataclass

import numpy as np

LEVEL = 0.95  # of intervals by resampling
ENDS = ((1 - LEVEL) / 2, (1 + LEVEL) / 2)
RESAMPLES = 10_000  # of the bootstrap
FEW = 5  # values up to which the bootstrap's interval of a median is nothing but their range


@dataclass(frozen=True)
class Interval:
    """Where the median of all seeds lies, judged by a few.

    Attributes:
        low: Lower end.
        high: Upper end.
        seeds: Number of values.
    """

    low: float
    high: float
    seeds: int

    @property
    def level(self) -> float:
        """Chance that such an interval holds the median: exact for a range (binomial), nominal for a bootstrap."""
        return 1 - 2 ** (1 - self.seeds) if self.seeds <= FEW else LEVEL

    @property
    def kind(self) -> str:
        """What it is, for the head of a column."""
        return kind_of(self.seeds)

    def describe(self) -> dict[str, object]:
        """Return it for JSON."""
        return {"low": self.low, "high": self.high, "kind": self.kind, "level": self.level}


def kind_of(seeds: int) -> str:
    """Say what the interval of a median over seeds is."""
    if seeds < FEW:
        return f"range of {seeds} seeds"
    return f"range of {seeds} seeds, {1 - 2 ** (1 - seeds):.0%}" if seeds == FEW else f"bootstrap, {LEVEL:.0%}"


def bootstrap_of(seeds: int) -> str:
    """Say what an interval by resampling seeds is: with few of them it holds the truth less often than its level."""
    return f"bootstrap of {seeds} seeds" if seeds <= FEW else f"bootstrap, {LEVEL:.0%}"


def median_interval(values: np.ndarray) -> Interval:
    """Return the interval of the median of values over seeds, shape (seeds,)."""
    if len(values) <= FEW:
        return Interval(float(values.min()), float(values.max()), len(values))
    low, high = np.quantile(resample_medians(values, np.random.default_rng(0)), ENDS)
    return Interval(float(low), float(high), len(values))


def median_text(values: np.ndarray) -> str:
    """Return the median over seeds with its interval, which a single seed does not have."""
    if len(values) < 2:
        return f"{np.median(values):.2f}"
    found = median_interval(values)
    return f"{np.median(values):.2f} [{found.low:.2f}, {found.high:.2f}]"


def resample_medians(values: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return medians of resamples with replacement, shape (RESAMPLES,)."""
    return np.median(rng.choice(values, (RESAMPLES, len(values))), axis=1)
