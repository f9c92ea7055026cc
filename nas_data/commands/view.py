"""View an episode in Rerun: the measured arm and its models as ghosts, with all signals."""

from dataclasses import dataclass
from pathlib import Path

from nas_data.commands._ghosts import ShowsEpisode
from nas_data.commands.base import CommandResult
from nas_data.errors import OptionError, OutputExists


@dataclass(frozen=True, kw_only=True)
class View(ShowsEpisode):
    """Show the measured arm, models under the same commands, and all signals in Rerun, in LeRobot's layout.

    Example: nas view datasets/arm --model arm.xml --model runs/gap/model.xml --episode 3
    """

    out: Path | None = None
    """Write this file instead of opening a window; `rerun FILE.rrd` opens it on any machine."""

    def run(self) -> CommandResult:
        """Simulate and log."""
        if self.out is not None and self.out.suffix != ".rrd":
            raise OptionError(f"--out {self.out} must end in .rrd, the suffix of Rerun's recordings.")
        if self.out is not None and self.out.exists():
            raise OutputExists(f"{self.out} exists; choose another --out.")
        from nas_data.reports.films.rerun_log import RerunLog

        recording = RerunLog(self.dataset.name, self.episode, self.out)
        root, motion = self.motion()
        recording.log(motion)
        arms = [ghost.name for ghost in motion.ghosts]
        where = f"{self.out}; open it with: rerun {self.out}" if self.out else "Rerun's window"
        return CommandResult(
            f"{', '.join(arms)} in episode {self.episode} of {root}, {motion.times[-1]:.2f} s → {where}",
            {"dataset": root, "episode": self.episode, "arms": arms, "recording": self.out},
        )
