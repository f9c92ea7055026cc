"""Time our training of φ against the paper's recipe, to the same held-out loss."""

from dataclasses import dataclass

from nas_data.commands._benchmark import Benchmark


@dataclass(frozen=True, kw_only=True)
class BenchmarkTraining(Benchmark):
    """Give the paper's recipe a budget of processor time, then train ours until its held-out loss is as low.

    Example: nas benchmark training --budget 15
    """

    episodes: int = 250
    """Episodes of ErgoReacher with backlash, one second each."""
    budget: int = 15
    """Processor time of the paper's recipe [s]; twice, for it is also tried at a tenth of its learning rate."""
    seeds: int = 3
    """Repetitions with other weights, split and order; the median counts."""
