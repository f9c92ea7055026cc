"""Render an episode as a video: the measured arm and its models as ghosts in one scene."""

from dataclasses import dataclass
from pathlib import Path

from nas_data.commands._ghosts import ShowsEpisode
from nas_data.commands.base import CommandResult
from nas_data.count_of import count_of
from nas_data.errors import OptionError, OutputExists
from nas_data.runs.progress import Counting


@dataclass(frozen=True, kw_only=True)
class Render(ShowsEpisode):
    """Render the measured arm (solid) and models under the same commands (transparent): one video and one picture.

    Example: nas render datasets/arm --model arm.xml --model runs/gap/model.xml --episode 3 --out film.mp4
    """

    out: Path = Path("film.mp4")
    """Output video; a picture with suffix .png is written as well. With suffix .png, only the picture."""
    at: float | None = None
    """Time of the picture [s after the episode's start]; by default when the first model has its largest error."""
    start: float = 0.0
    """Start of the video [s after the episode's start]."""
    seconds: float | None = None
    """Length of the shown part of the episode [s]; all by default."""
    rate: int = 30
    """Frames per second."""
    speed: float = 1.0
    """Playback speed; below 1 is slow motion."""
    width: int = 960
    """Width of a picture [px]."""
    height: int = 720
    """Height of a picture, with its caption [px]."""
    azimuth: float = 120.0
    """Azimuth of the camera's view [deg]."""
    elevation: float = -15.0
    """Elevation of the camera's view [deg]; negative looks down."""

    def run(self) -> CommandResult:
        """Simulate, render and write."""
        if self.out.suffix not in (".mp4", ".png"):
            raise OptionError(f"--out {self.out} must end in .mp4 (a film and a picture) or .png (the picture alone).")
        picture, film_file = self.out.with_suffix(".png"), self.out if self.out.suffix == ".mp4" else None
        for file in filter(None, (picture, film_file)):
            if file.exists():
                raise OutputExists(f"{file} exists; choose another --out.")
        from nas_data.reports.films.film import Film, find_frame, select_frames, write_mp4, write_png

        root, motion = self.motion()
        chosen = select_frames(motion, self.start, self.seconds, self.rate, self.speed)
        still = motion.worst if self.at is None else find_frame(motion, self.at, "--at")
        film = Film(motion, self.dataset.name, (self.height, self.width), self.azimuth, self.elevation)
        try:
            write_png(film.picture(still), picture)
            if film_file:
                write_mp4(film, chosen, self.rate, film_file, Counting("drawing"))
        finally:
            film.close()
        arms, frames = [ghost.name for ghost in motion.ghosts], len(chosen) if film_file else 0
        text = f"{', '.join(arms)} in episode {self.episode} of {root}\n  at {motion.times[still]:.2f} s → {picture}"
        return CommandResult(
            text + (f"\n  {count_of(frames, 'picture')} → {film_file}" if film_file else ""),
            {
                "dataset": root,
                "episode": self.episode,
                "arms": arms,
                "picture": picture,
                "picture_at_s": float(motion.times[still]),
                "film": film_file,
                "frames": frames,
            },
        )
