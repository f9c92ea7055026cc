"""What `nas train delta` and `nas train forward` share: options, data, source, training, evaluation."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import tyro

from nas_data.commands._actuators import TakesModel
from nas_data.commands._patience import Counting
from nas_data.commands.base import Outcome

if TYPE_CHECKING:
    from collections.abc import Mapping

    from nas_data.dataset.dataset import Dataset
    from nas_data.simulators.base import Simulator


@dataclass(frozen=True, kw_only=True)
class Train(TakesModel):
    """Options of a training; None leaves the preset's value."""

    kind: ClassVar[Literal["delta", "forward"]]

    dataset: tyro.conf.Positional[Path]
    """Dataset: a version's folder, or datasets/NAME for its newest version."""
    out: Path | None = None
    """Folder for checkpoint, history and TensorBoard files; runs/KIND-NAME-seedN otherwise."""
    model: str | None = None
    """Source that the dataset was paired with, a model file or robot; needed only where the dataset keeps none."""
    engine: str | None = None
    """Engine of the source: mujoco or bullet; the one it was paired in where it is kept, else mujoco."""
    preset: str = "fast"
    """fast; few, for recordings of a few minutes (one layer, short windows, strong weight decay); symmetric, for as
    little of an arm that takes torques and whose model says how it is symmetric (φ corrects the torques); or paper (its
    published recipe: teacher forcing, batch 1, learning rate 0.01, 250 epochs)."""
    hidden: int | None = None
    """Units of each LSTM layer (128, 256 or 100 in the paper)."""
    epochs: int | None = None
    """Passes over the data with teacher forcing (with --updates 0, or where the source is not at hand)."""
    updates: int | None = None
    """Updates in free running; 0 trains by teacher forcing."""
    horizon: int | None = None
    """Longest free-running window [frames]."""
    validation: float | None = None
    """Share held out for early stopping: of the episodes, or of each where they are few."""
    episodes: Annotated[tuple[int, ...], tyro.conf.arg(metavar="N…")] = ()
    """Use only these episodes; all by default."""
    seed: int = 0
    """Seed of weights, split, order and windows."""
    device: str | None = None
    """torch device; a GPU where there is one by default."""

    def run(self) -> Outcome:
        """Train, evaluate on the held-out episodes beside the baselines, and say where the checkpoint lies."""
        from nas_data.dataset import versions
        from nas_data.dataset.foreign import take_in, warn
        from nas_data.dataset.provenance import read_provenance
        from nas_data.dataset.read import read
        from nas_data.models.evaluation import evaluate
        from nas_data.models.presets import preset
        from nas_data.models.run import CHECKPOINT, TrainingRun
        from nas_data.models.training import Training

        options = preset(
            self.preset,
            hidden=self.hidden,
            epochs=self.epochs,
            updates=self.updates,
            horizon=self.horizon,
            validation=self.validation,
            seed=self.seed,
        )
        root = versions.resolve(self.dataset)
        full = read(root)
        if self.kind == "delta":
            versions.check_paired(root, full, "A delta model")
        dataset, derived, noticed = take_in(root, full.select(self.episodes) if self.episodes else full)
        warn(noticed)
        notes = [f"derived {key}: {how}" for key, how in derived.items()]
        parent = versions.parent_of(root, full)
        provenance: dict[str, object] = {
            "dataset": {"name": parent.name, "content_hash": parent.content_hash, "episodes": list(self.episodes)}
        }
        folder = self.out or Path("runs") / f"{self.kind}-{parent.name.split('/')[0]}-seed{self.seed}"
        simulator, kept = self._source(root, dataset, notes)
        if simulator is not None:
            recorded = read_provenance(root) if self.model is None else None
            provenance["source"] = (recorded and recorded.source) or simulator.describe()
        training = Training(self.kind, dataset, options, simulator, provenance, self.device)
        training_run = TrainingRun(training, folder, report, kept)
        notes.append(f"{dataset.n_episodes} episodes, {dataset.n_frames} transitions; held out: {training.split.what}")
        notes.append(f"{training.phase.name}, {training.phase.updates} updates; validation is {training.criterion}")
        for note in notes:  # only now: bad input is one sentence and nothing else
            report(note)
        model = training_run.run()
        known = simulator is not None or self.kind == "forward"
        counting = Counting("rolling out what was held out")
        evaluation = evaluate(training.split.held, simulator, model, counting) if known else None
        text = f"{evaluation.text()}\n\n" if evaluation else ""
        title = f"Held out ({training.split.what}):\n\n" if evaluation else ""
        return Outcome(
            f"{title}{text}checkpoint → {folder / CHECKPOINT}",
            {
                "checkpoint": folder / CHECKPOINT,
                "held_out": training.split.what,
                "history": folder / "history.json",
                "errors": evaluation.to_json() if evaluation else None,
            },
        )

    def _source(
        self, root: Path, dataset: "Dataset", notes: list[str]
    ) -> "tuple[Simulator | None, Mapping[str, bytes]]":
        """Return the source and the files that keep it with the checkpoint; None, with a note, where there is none."""
        from nas_data.errors import ModelFileError
        from nas_data.pairing import check_source, warn_of_ranges
        from nas_data.robots.base import find_robot
        from nas_data.sources import find_source, kept_files, source_files

        model = self.actuated(self.model)
        try:
            simulator = find_source(model, (), dataset, [root], self.engine)
        except ModelFileError as error:
            if model is not None:
                raise
            if self.kind == "delta":
                notes.append(
                    f"{error} Without it, training is by teacher forcing alone, and open-loop errors cannot be told."
                )
            return None, {}
        if self.kind == "delta" and dataset.paired:
            check_source(dataset, simulator)
        if model is None:
            return simulator, kept_files(root)
        robot = find_robot(model)
        warn_of_ranges(dataset, robot.spec().compile())
        return simulator, source_files(robot)


def report(line: str) -> None:
    """Show progress on stderr."""
    print(line, file=sys.stderr, flush=True)
