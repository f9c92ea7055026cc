"""Share of the remaining gap that φ learns from the training episodes."""

import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from nas_data.dataset.dataset import Dataset
from nas_data.metrics import Errors
from nas_data.models.evaluation import roll_out_model
from nas_data.models.presets import preset
from nas_data.models.run import TrainingRun
from nas_data.models.training import ModelTraining, compute_error_scales
from nas_data.open_loop import roll_out_source
from nas_data.pairing import pair
from nas_data.robots.base import Robot, find_robot
from nas_data.simulators.engines import load_simulator
from nas_data.sources import collect_source_files

PHI = "phi"  # folder of the checkpoint within that of the report


def measure_learned_shares(
    dataset: Dataset,
    models: tuple[str | Path | Robot, Path],
    episodes: tuple[Sequence[int], Sequence[int]],
    folder: Path,
    updates: int,
    say: Callable[[str], None],
) -> Mapping[str, float]:
    """Train φ with the written model as source, and divide the squared gap into its parts.

    Rollouts start at rest at the first measured position, as in the training of φ.

    Args:
        dataset: Transitions as recorded.
        models: Given model and written model.
        episodes: Numbers of the training and held-out episodes.
        folder: Folder of the report; the checkpoint is written to `phi/`.
        updates: Number of updates with free running.
        say: Receives progress messages.

    Returns:
        Shares of the squared open-loop position error over whole held-out episodes: `names`, `learned` (negative if φ
            increases the error) and `left`.
    """
    period = 1 / dataset.fps
    given, written = (load_simulator(model, period, dataset.joints) for model in models)
    train, held = (pair(dataset.select(list(numbers)), written) for numbers in episodes)
    shutil.rmtree(folder / PHI, ignore_errors=True)
    training = ModelTraining("delta", train, preset("fast", updates=updates), written, {"source": written.describe()})
    phi = TrainingRun(training, folder / PHI, say, collect_source_files(find_robot(models[1]))).run()
    scales = compute_error_scales(train)
    before, after = (
        mean_squared_error(held, roll_out_source(held, simulator), scales) for simulator in (given, written)
    )
    left = mean_squared_error(held, roll_out_model(held, written, phi), scales)
    return {"names": 1 - after / before, "learned": (after - left) / before, "left": left / before}


def mean_squared_error(dataset: Dataset, predicted: list[np.ndarray], scales: np.ndarray) -> float:
    """Return the mean squared position error of open-loop rollouts over all joints' scales (n,)."""
    measured = [dataset.next_states[rows] for rows in dataset.episodes()]
    return Errors.of(dataset.joints, predicted, measured).over(scales) ** 2
