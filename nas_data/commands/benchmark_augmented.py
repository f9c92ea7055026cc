"""Time PPO in the augmented environment against plain environments and one network per environment."""

from dataclasses import dataclass

from nas_data.commands._benchmark import Benchmark


@dataclass(frozen=True, kw_only=True)
class BenchmarkAugmented(Benchmark):
    """Time PPO in environments with one batched φ, without φ, and with one network each, alternating; processor time.

    Example: nas benchmark augmented --rounds 15
    """

    frames: int = 2048
    """Frames of a rollout, over all environments; at least 64."""
    rounds: int = 15
    """Number of timed rounds; the result is their median."""
