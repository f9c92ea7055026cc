"""Training of a network inside a trial: silently, on one CPU thread, so that results are bit-reproducible.

Separate file, because trials that only name effects must not depend on training code.
"""

from pathlib import Path

from nas_data.dataset.dataset import Dataset
from nas_data.models.lstm import DynamicsModel, Kind
from nas_data.models.presets import TrainingOptions
from nas_data.models.run import TrainingRun
from nas_data.models.training import ModelTraining
from nas_data.runs.progress import silence
from nas_data.simulators.base import Simulator


def train(
    kind: Kind, data: Dataset, simulator: Simulator | None, options: TrainingOptions, folder: Path
) -> DynamicsModel:
    """Train φ or ψ; normalisation, shortcut and early stopping use these transitions alone.

    Args:
        kind: `delta` for φ, `forward` for ψ.
        data: Transitions; paired with the simulator for φ.
        simulator: Source, for φ.
        options: Options of the training.
        folder: Folder of checkpoint and history while it runs.

    Raises:
        DatasetInvalid: there is too little to train on.
    """
    training = ModelTraining(kind, data, options, simulator, device="cpu")
    return TrainingRun(training, folder / "training", silence).run()
