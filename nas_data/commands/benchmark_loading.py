"""Time reading a dataset into tensors against a DataLoader over LeRobot's dataset[i]."""

from dataclasses import dataclass

from nas_data.commands._benchmark import Benchmark


@dataclass(frozen=True, kw_only=True)
class BenchmarkLoading(Benchmark):
    """Read a whole dataset with our reader and a part of it with LeRobot's, in turns.

    Example: nas benchmark loading --episodes 100 --frames 300
    """

    episodes: int = 100
    """Episodes of the dataset."""
    frames: int = 300
    """Frames of each episode."""
    batches: int = 20
    """Batches of 256 frames that the DataLoader reads in a round; its time per frame is extrapolated."""
    rounds: int = 5
    """Number of timed rounds; the result is their median."""
