"""Time recording and pairing in bulk against Gymnasium environments and LeRobot's writer."""

from dataclasses import dataclass

from nas_data.commands._benchmark import Benchmark


@dataclass(frozen=True, kw_only=True)
class BenchmarkRecording(Benchmark):
    """Record the same paired episodes both ways, in turns: our two commands, and add_frame with save_episode.

    Example: nas benchmark recording --episodes 20 --frames 300
    """

    episodes: int = 20
    """Episodes recorded in a round."""
    frames: int = 300
    """Frames of each episode."""
    rounds: int = 3
    """How often each side is timed; the median counts."""
