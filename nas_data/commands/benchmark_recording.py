"""Time recording and pairing in bulk against Gymnasium environments and LeRobot's writer."""

from dataclasses import dataclass

from nas_data.commands._benchmark import Benchmark


@dataclass(frozen=True, kw_only=True)
class BenchmarkRecording(Benchmark):
    """Record and pair the same episodes with `nas`, and with Gymnasium and LeRobot's writer, in turns.

    Example: nas benchmark recording --episodes 20 --frames 300
    """

    episodes: int = 20
    """Episodes recorded in a round."""
    frames: int = 300
    """Frames of each episode."""
    rounds: int = 3
    """Number of timed rounds; the result is their median."""
