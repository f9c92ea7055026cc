"""What the commands that show an episode share: the recording, the models beside it, and which episode."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from nas_data.commands._actuators import TakesModel

if TYPE_CHECKING:
    from nas_data.reports.films.motion import Motion


@dataclass(frozen=True, kw_only=True)
class ShowsEpisode(TakesModel):
    """A command that shows an episode as it was measured, and as models have it."""

    dataset: tyro.conf.Positional[Path]
    """Dataset: a version's folder, or datasets/NAME for its newest version."""
    model: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    """Model file or robot to show beside what was measured; may be given several times. The source kept with the
    dataset otherwise."""
    engine: str | None = None
    """Engine of the models: mujoco or bullet; mujoco for models given, else the one in which the dataset was paired."""
    episode: int = 0
    """Which episode."""

    def motion(self) -> "tuple[Path, Motion]":
        """Return the dataset's folder, and how the arms move in the episode."""
        from nas_data.api.arguments import as_models
        from nas_data.dataset import versions
        from nas_data.dataset.dataset import Dataset
        from nas_data.errors import OptionError
        from nas_data.reports.films.motion import follow
        from nas_data.runs.progress import report_elapsed

        if self.actuators != "position" and not self.model:
            raise OptionError("--actuators is for a URDF given with --model; without one, leave it out.")
        root = versions.resolve(self.dataset)
        dataset = Dataset.load(root, (self.episode,))
        with report_elapsed("simulating"):
            return root, follow(dataset, self.episode, as_models(self.model, self.actuators), self.engine)
