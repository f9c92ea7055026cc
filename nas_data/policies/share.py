"""How much of what is at stake a method wins: its share of the distance from the source's return to the expert's."""

from dataclasses import dataclass

import numpy as np

RESAMPLES = 10_000  # of the bootstrap
NOTHING = 1e-9  # part of the returns by which the expert must be better for something to be at stake
LEVEL = 0.95  # of its intervals


@dataclass(frozen=True)
class Share:
    """Share of the distance from the source's return to the expert's.

    Attributes:
        value: (median of method − median of source) / (median of expert − median of source); NaN where the expert
            is no better than the source, so that nothing is at stake.
        low: Lower end of the 95 % bootstrap interval over seeds.
        high: Upper end.
        at_stake: Median of expert − median of source, in return.
    """

    value: float
    low: float
    high: float
    at_stake: float

    def __str__(self) -> str:
        """Return it in per cent, with its interval unless all resamples are alike, as those of a single seed are."""
        if np.isnan(self.value):
            return "nothing at stake"
        if self.low == self.high:
            return f"{self.value:.0%}"
        return f"{self.value:.0%} [{self.low:.0%}, {self.high:.0%}]"

    def describe(self) -> dict[str, object]:
        """Return the share for JSON."""
        return {"value": self.value, "interval95": [self.low, self.high], "at_stake": self.at_stake}


def share(method: np.ndarray, source: np.ndarray, expert: np.ndarray) -> Share:
    """Return the share of the distance from source to expert that a method closes.

    The interval resamples the seeds of all three; resamples in which the expert is no better than the source say
    nothing and are left out.

    Args:
        method: Return of each seed, shape (seeds,).
        source: Returns of policies that learned in the source.
        expert: Returns of policies that learned on the target.
    """
    start, end = float(np.median(source)), float(np.median(expert))
    if end - start <= NOTHING * max(1.0, abs(start), abs(end)):
        return Share(np.nan, np.nan, np.nan, end - start)
    rng = np.random.default_rng(0)
    starts, ends, reached = (resampled_medians(values, rng) for values in (source, expert, method))
    telling = ends - starts > NOTHING * np.maximum(1.0, np.maximum(abs(starts), abs(ends)))
    shares = (reached - starts)[telling] / (ends - starts)[telling]
    low, high = np.quantile(shares, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return Share(float((np.median(method) - start) / (end - start)), float(low), float(high), end - start)


def resampled_medians(values: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return medians of resamples with replacement, shape (RESAMPLES,)."""
    return np.median(rng.choice(values, (RESAMPLES, len(values))), axis=1)
