"""Relative score of a method: its share of the difference between the source's and the expert's returns."""

from dataclasses import dataclass

import numpy as np

from nas_data.policies.intervals import ENDS, describe_bootstrap, resample_medians

MIN_ADVANTAGE = 1e-9  # least relative advantage of the expert for which the score is defined


@dataclass(frozen=True)
class Share:
    """Share of the difference between the source's and the expert's returns.

    Attributes:
        value: (median of method − median of source) / (median of expert − median of source); NaN if the
            expert is not better than the source.
        low: Lower end of the bootstrap interval over seeds; see `describe_bootstrap`.
        high: Upper end.
        at_stake: Median of expert − median of source, in return.
        seeds: Number of seeds of the method.
    """

    value: float
    low: float
    high: float
    at_stake: float
    seeds: int

    def __str__(self) -> str:
        """Return the share in per cent, with its interval unless all resamples are equal, as for a single seed."""
        if np.isnan(self.value):
            return "nothing at stake"
        if self.low == self.high:
            return f"{self.value:.0%}"
        return f"{self.value:.0%} [{self.low:.0%}, {self.high:.0%}]"

    def describe(self) -> dict[str, object]:
        """Return the share for JSON."""
        interval = {"interval": [self.low, self.high], "interval_is": describe_bootstrap(self.seeds)}
        return {"value": self.value, **interval, "at_stake": self.at_stake}


def compute_share(method: np.ndarray, source: np.ndarray, expert: np.ndarray) -> Share:
    """Return the relative score of a method between source and expert.

    The interval resamples the seeds of all three. Resamples in which the expert is not better than the source are
    undefined and left out.

    Args:
        method: Return of each seed, shape (seeds,).
        source: Returns of policies trained in the source, shape (seeds,).
        expert: Returns of policies that learned on the target.
    """
    start, end = float(np.median(source)), float(np.median(expert))
    if end - start <= MIN_ADVANTAGE * max(1.0, abs(start), abs(end)):
        return Share(np.nan, np.nan, np.nan, end - start, len(method))
    rng = np.random.default_rng(0)
    starts, ends, reached = (resample_medians(values, rng) for values in (source, expert, method))
    telling = ends - starts > MIN_ADVANTAGE * np.maximum(1.0, np.maximum(abs(starts), abs(ends)))
    shares = (reached - starts)[telling] / (ends - starts)[telling]
    low, high = np.quantile(shares, ENDS)
    closed = float((np.median(method) - start) / (end - start))
    return Share(closed, float(low), float(high), end - start, len(method))


def format_share_heading(seeds: int) -> str:
    """Return the heading of a column of shares, with the kind of their intervals."""
    return f"distance closed [{describe_bootstrap(seeds)}]" if seeds > 1 else "distance closed"


@dataclass(frozen=True)
class ReturnRange:
    """Difference of the expert's and the source's returns, by medians over seeds.

    Attributes:
        value: Median of expert − median of source.
        low: Lower end of its bootstrap interval over seeds; equal to the value for a single seed.
        high: Upper end.
        seeds: Number of seeds of each.
        shown: Whether the whole interval is above zero.
    """

    value: float
    low: float
    high: float
    seeds: int
    shown: bool

    def sentence(self) -> str | None:
        """Return a sentence if expert and source score the same; None otherwise."""
        if self.shown:
            return None
        return (
            f"Source and expert show no distance here (expert − source: {self.value:.2f} "
            f"[{self.low:.2f}, {self.high:.2f}], {describe_bootstrap(self.seeds)}): nothing is at stake, and the share "
            "of it that a method closes says nothing; make the gap larger."
        )

    def describe(self) -> dict[str, object]:
        """Return it for JSON."""
        interval = {"interval": [self.low, self.high], "interval_is": describe_bootstrap(self.seeds)}
        return {"value": self.value, **interval, "shown": self.shown}


def compute_return_range(source: np.ndarray, expert: np.ndarray) -> ReturnRange:
    """Return the difference of the expert's and the source's returns.

    Args:
        source: Return of each seed, shape (seeds,).
        expert: Returns of policies that learned on the target.
    """
    rng = np.random.default_rng(0)
    low, high = np.quantile(resample_medians(expert, rng) - resample_medians(source, rng), ENDS)
    least = MIN_ADVANTAGE * max(1.0, float(abs(np.median(source))), float(abs(np.median(expert))))
    value = float(np.median(expert) - np.median(source))
    return ReturnRange(value, float(low), float(high), len(source), bool(low > least))
