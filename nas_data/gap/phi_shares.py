"""φ on the remaining gap: trained on the training episodes, kept if it helps on held-out ones."""

import math
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.torque_off import drop_rows_without_torque
from nas_data.gap.output_folder import PHI
from nas_data.gap.report_parts import LearnedCorrection
from nas_data.joint_units import SHARE, JointUnit, group_by_kind
from nas_data.metrics import Errors
from nas_data.models.predictions import roll_out_model
from nas_data.models.presets import choose_preset, preset
from nas_data.models.regimes import RegimeErrors
from nas_data.models.run import TrainingRun
from nas_data.models.training import ModelTraining, compute_error_scales
from nas_data.open_loop import roll_out_source
from nas_data.pairing import pair
from nas_data.robots.base import Robot, find_robot
from nas_data.simulators.engines import load_simulator
from nas_data.sources import collect_source_files


def learn_correction(
    dataset: Dataset,
    models: tuple[str | Path | Robot, Path],
    episodes: tuple[Sequence[int], Sequence[int]],
    folder: Path,
    updates: int,
    say: Callable[[str], None],
) -> LearnedCorrection:
    """Train φ with the written model as source, compare both on held-out episodes, and keep φ only if it helps.

    Rollouts start at rest at the first measured position, as in the training of φ.

    Args:
        dataset: Transitions as recorded.
        models: Given model and written model.
        episodes: Numbers of the training and held-out episodes.
        folder: Folder of the report; the checkpoint is written to `phi/`, which is removed if φ does not help.
        updates: Number of updates with free running.
        say: Receives progress messages, and the regimes of motion in which φ helps.
    """
    period = 1 / dataset.fps
    given, written = (load_simulator(model, period, dataset.joints) for model in models)
    parts = (drop_rows_without_torque(dataset.select(list(numbers)))[0] for numbers in episodes)
    train, held = (pair(part, written) for part in parts)
    shutil.rmtree(folder / PHI, ignore_errors=True)
    options = preset(choose_preset("delta", train.commands_positions), updates=updates)
    training = ModelTraining("delta", train, options, written, {"source": written.describe()})
    phi = TrainingRun(training, folder / PHI, say, collect_source_files(find_robot(models[1]))).run()
    source, corrected = roll_out_source(held, written), roll_out_model(held, written, phi)
    for finding in RegimeErrors.of(held, source, corrected).list_findings():
        say(finding)
    scales = compute_error_scales(train)
    with_phi = measure_error(held, corrected, scales)
    learned = LearnedCorrection(
        given=measure_error(held, roll_out_source(held, given), scales),
        written=measure_error(held, source, scales),
        corrected=with_phi if math.isfinite(with_phi) else None,
        unit=find_error_unit(train).si,
    )
    if not learned.helps:
        shutil.rmtree(folder / PHI)
    return learned


def measure_error(dataset: Dataset, predicted: list[np.ndarray], scales: np.ndarray) -> float:
    """Return the RMS position error of open-loop rollouts over all joints' scales (n,)."""
    measured = [dataset.next_states[rows] for rows in dataset.episodes()]
    return Errors.of(dataset.joints, predicted, measured).over(scales)


def find_error_unit(train: Dataset) -> JointUnit:
    """Return the unit of errors over `compute_error_scales`."""
    kinds = group_by_kind(train.joints, train.slides)
    return kinds[0][0] if len(kinds) == 1 else SHARE
