"""Time `nas pair` against the bare mujoco.rollout calls that it needs."""

from dataclasses import dataclass

from nas_data.commands._benchmark import Benchmark


@dataclass(frozen=True, kw_only=True)
class BenchmarkPairing(Benchmark):
    """Pair a recorded dataset and run the bare rollouts, in turns; a ratio of 1 means no overhead.

    Example: nas benchmark pairing --episodes 300 --frames 300
    """

    episodes: int = 300
    """Episodes of the dataset."""
    frames: int = 300
    """Frames of each episode."""
    rounds: int = 9
    """Number of timed rounds; the result is their median."""
