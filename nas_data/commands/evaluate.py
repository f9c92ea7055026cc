"""Compare φ or ψ with hold, source and command on any dataset."""

from dataclasses import dataclass
from pathlib import Path

import tyro

from nas_data.commands._actuators import TakesModel
from nas_data.commands._patience import Counting
from nas_data.commands.base import Outcome


@dataclass(frozen=True, kw_only=True)
class Evaluate(TakesModel):
    """Print one-step and open-loop errors of a checkpoint or a model file on a dataset, beside the trivial baselines.

    Example: nas evaluate runs/phi/checkpoint datasets/arm_test --model arm.xml
    """

    checkpoint: tyro.conf.Positional[Path]
    """Folder written by `nas train` (its `checkpoint`, or the training's folder), or an MJCF or URDF file."""
    dataset: tyro.conf.Positional[Path]
    """Dataset to evaluate on; need not be paired."""
    model: str | None = None
    """Source that φ corrects: a model file or robot; the one kept with the checkpoint or dataset otherwise."""
    engine: str | None = None
    """Engine of the source: mujoco or bullet; the one it was paired in where it is kept, else mujoco."""
    episodes: tuple[int, ...] = ()
    """Use only these episodes; all by default."""

    def run(self) -> Outcome:
        """Evaluate and return the tables."""
        from nas_data.dataset import versions
        from nas_data.dataset.foreign import take_in, warn
        from nas_data.dataset.read import read
        from nas_data.errors import ModelFileError, OptionError
        from nas_data.models import checkpoint
        from nas_data.models.evaluation import evaluate
        from nas_data.pairing import warn_of_ranges
        from nas_data.robots.base import find_robot
        from nas_data.sources import find_source

        alone = self.checkpoint.is_file()  # a checkpoint is a folder
        folder = self.checkpoint if alone else checkpoint.find(self.checkpoint)
        model = None if alone else checkpoint.load_frozen(folder)
        root = versions.resolve(self.dataset)
        dataset = read(root)
        dataset, derived, noticed = take_in(root, dataset.select(self.episodes) if self.episodes else dataset)
        warn(noticed)
        if model is not None:
            checkpoint.check_fits(model, dataset, folder)
        elif self.model is not None:
            raise OptionError(
                f"{folder} is a model by itself; leave out --model, or give a checkpoint that corrects it."
            )
        given = self.actuated(str(folder) if alone else self.model)
        try:
            simulator = find_source(given, (), dataset, [folder, root], self.engine)
        except ModelFileError:
            if self.model is not None or model is None or model.kind == "delta":
                raise
            simulator = None
        if simulator is not None and given is not None:
            warn_of_ranges(dataset, find_robot(given).spec().compile())
        evaluation = evaluate(dataset, simulator, model, Counting("rolling out"))
        seen = None if model is None else model.provenance.get("dataset")
        name = seen.get("name") if isinstance(seen, dict) else "unknown"
        origin = "a model" if model is None else f"trained on {name}"
        head = [f"{folder} ({origin}) on {root}: {dataset.n_episodes} episodes, {dataset.n_frames} frames"]
        head += [f"derived {key}: {how}" for key, how in derived.items()]
        data = {"checkpoint": folder, "dataset": root, "trained_on": seen, "derived": derived, **evaluation.to_json()}
        return Outcome("\n".join([*head, "", evaluation.text(), "", evaluation.episodes_text()]), data)
