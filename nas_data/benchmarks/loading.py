"""Reading a whole dataset into tensors, compared with a DataLoader over LeRobot's `dataset[i]`."""

from itertools import islice
from pathlib import Path

from torch.utils.data import DataLoader

from nas_data.api.recording import record
from nas_data.benchmarks.datasets import lerobot, open_dataset, pair_folder, write_version
from nas_data.benchmarks.result import BenchmarkResult, Ratio, take_turns
from nas_data.dataset.read import read
from nas_data.dataset.transitions import as_transitions
from nas_data.models.episodes import read_episodes
from nas_data.runs.progress import say

ROBOT = "ergojr"
RATE = 100.0  # [Hz]
BATCH = 256
GOAL = 30.0
OURS, OTHER = "nas, all frames", "DataLoader"


def benchmark(scratch: Path, episodes: int, frames: int, batches: int, rounds: int) -> BenchmarkResult:
    """Time our reader (files to one tensor per feature and episode) and LeRobot's reader.

    Args:
        scratch: Empty folder.
        episodes: Episodes of the dataset.
        frames: Frames of each episode.
        batches: Batches of 256 frames that the DataLoader reads in a round, from the start of the dataset.
        rounds: Number of timed rounds.
    """
    say(f"recording {episodes} episodes of {frames} frames …")
    dataset = record(ROBOT, rate=RATE, episodes=episodes, seconds=frames / RATE)
    recorded = write_version(dataset, scratch / "recorded")
    root = pair_folder(recorded, ROBOT, scratch / "paired")

    def ours() -> int:
        dataset, _ = as_transitions(read(root))
        return sum(len(episode) for episode in read_episodes(dataset))

    with lerobot(scratch) as kind:
        dataset = open_dataset(kind, root)

        def other() -> int:
            loader = DataLoader(dataset, batch_size=BATCH, num_workers=0)
            return sum(len(batch["index"]) for batch in islice(loader, batches))

        times = take_turns({OURS: ours, OTHER: other}, rounds)
    part = min(batches * BATCH, len(dataset))
    return BenchmarkResult(
        title=f"Loading {len(dataset)} paired frames of {ROBOT} into torch tensors",
        times=times,
        ratios=(Ratio("loading_vs_dataloader", OURS, OTHER, GOAL),),
        notes=(
            f"'{OURS}' opens the files and reads all {len(dataset)} frames; '{OTHER}' (batches of {BATCH}, no workers) "
            f"reads the first {part} of an open dataset: its time per frame is extrapolated.",
        ),
    )
