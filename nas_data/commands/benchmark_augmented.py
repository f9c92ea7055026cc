"""Time PPO in the augmented environment against plain environments and one network an environment."""

from dataclasses import dataclass

from nas_data.commands._benchmark import Benchmark


@dataclass(frozen=True, kw_only=True)
class BenchmarkAugmented(Benchmark):
    """Learn with PPO in environments with φ, without it, and with a network each, in turns; processor time counts.

    Example: nas benchmark augmented --rounds 15
    """

    frames: int = 2048
    """Frames of a rollout, over all environments; at least 64."""
    rounds: int = 15
    """How often each side is timed; the median counts."""
