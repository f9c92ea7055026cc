"""Time our training of φ against the paper's recipe, to equal held-out loss."""

from dataclasses import dataclass

from nas_data.commands._benchmark import Benchmark


@dataclass(frozen=True, kw_only=True)
class BenchmarkTraining(Benchmark):
    """Train by the paper's recipe for a given processor time, then train ours until its held-out loss is as low.

    Example: nas benchmark training --budget 15
    """

    episodes: int = 250
    """Episodes of ErgoReacher with backlash, one second each."""
    budget: int = 15
    """Processor time of the paper's recipe [s]; spent twice, because a tenth of its learning rate is tried as well."""
    seeds: int = 3
    """Repetitions with other weights, split and order; the result is their median."""
