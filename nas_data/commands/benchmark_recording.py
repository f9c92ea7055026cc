"""Time recording and pairing in bulk against Gymnasium environments and LeRobot's writer."""

from dataclasses import dataclass

from nas_data.commands._benchmark import run_in_temporary_folder
from nas_data.commands.base import Command, CommandResult


@dataclass(frozen=True, kw_only=True)
class BenchmarkRecording(Command):
    """Record the same paired episodes both ways, in turns: our two commands, and add_frame with save_episode.

    Example: nas benchmark recording --episodes 20 --frames 300
    """

    episodes: int = 20
    """Episodes recorded in a round."""
    frames: int = 300
    """Frames of each episode."""
    rounds: int = 3
    """How often each side is timed; the median counts."""

    def run(self) -> CommandResult:
        """Measure in a folder that is removed afterwards."""
        from nas_data.benchmarks.recording import benchmark

        return run_in_temporary_folder(benchmark, episodes=self.episodes, frames=self.frames, rounds=self.rounds)
