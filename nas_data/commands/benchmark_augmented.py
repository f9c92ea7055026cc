"""Time PPO in the augmented environment against plain environments and one network per environment."""

from dataclasses import dataclass

from nas_data.commands._benchmark import Benchmark


@dataclass(frozen=True, kw_only=True)
class BenchmarkAugmented(Benchmark):
    """Measure the processor time of PPO in environments that share one φ, have no φ, or have one network each.

    Example: nas benchmark augmented --rounds 15
    """

    frames: int = 2048
    """Frames of a rollout, over all environments; at least 64."""
    rounds: int = 15
    """Number of timed rounds; the result is their median."""
