"""Options of the commands that show an episode: recording, models and episode."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from nas_data.commands._actuators import TakesModel

if TYPE_CHECKING:
    from nas_data.reports.films.motion import Motion


@dataclass(frozen=True, kw_only=True)
class ShowsEpisode(TakesModel):
    """A command that shows an episode as measured and as predicted by models."""

    dataset: tyro.conf.Positional[Path]
    """Dataset: a version's folder, or datasets/NAME for its newest version."""
    model: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    """Model file or robot to show with the measured arm; may be given several times. Default: the source stored with
    the dataset."""
    engine: str | None = None
    """Physics engine of the models: mujoco or bullet. Default: mujoco for given models, else that of the pairing."""
    episode: int = 0
    """Number of the episode."""

    def motion(self) -> "tuple[Path, Motion]":
        """Return the dataset's folder, and the motion of the arms in the episode."""
        from nas_data.api.arguments import as_models
        from nas_data.dataset import versions
        from nas_data.dataset.dataset import Dataset
        from nas_data.errors import OptionError
        from nas_data.reports.films.motion import follow
        from nas_data.runs.progress import begin

        if self.actuators != "position" and not self.model:
            raise OptionError("--actuators is for a URDF given with --model; without one, leave it out.")
        root = versions.resolve(self.dataset)
        dataset = Dataset.load(root, (self.episode,))
        begin("simulating")
        return root, follow(dataset, self.episode, as_models(self.model, self.actuators), self.engine)
