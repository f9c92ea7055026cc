"""The delta model φ alone: it shrinks the gap and names nothing."""

import tempfile
from pathlib import Path

import numpy as np

from nas_data.benchmarks.blind.baselines.base import Claim
from nas_data.dataset.read import read
from nas_data.models.augmented import LearnedStepper
from nas_data.models.lstm import DynamicsModel
from nas_data.models.presets import preset
from nas_data.models.run import TrainingRun
from nas_data.models.training import ModelTraining
from nas_data.pairing import pair
from nas_data.runs.progress import silence
from nas_data.simulators.mujoco import MujocoSimulator

# Multi-step rollouts for about a minute on one core, in smaller steps than the preset's. Without the closed-form
# shortcut: with velocities differenced from coarse positions it predicts worse than no correction.
SMALL = {"updates": 100, "frames": 1600, "horizon": 100, "shortcut": False}


def answer(dataset: Path, model: Path) -> Claim:
    """Train φ for about a minute on the recorded episodes."""
    recorded = read(dataset)
    simulator = MujocoSimulator.load(model, 1 / recorded.fps, recorded.joints, threads=1)
    options = preset("fast", **SMALL)
    training = ModelTraining("delta", pair(recorded, simulator), options, simulator)
    with tempfile.TemporaryDirectory() as folder:
        learned = TrainingRun(training, Path(folder) / "phi", report=silence).run()
    return Claim((), lambda commands, first: roll_out_corrected(simulator, learned, commands, first))


def roll_out_corrected(
    simulator: MujocoSimulator, learned: DynamicsModel, commands: np.ndarray, first: np.ndarray
) -> np.ndarray:
    """Return positions (E, T, n) [rad] of the source corrected by φ after every step."""
    stepper = LearnedStepper(simulator.stepper(len(first)), learned)
    stepper.reset(first)
    played = [stepper.step(commands[:, step])[:, : commands.shape[2]] for step in range(commands.shape[1])]
    return np.stack(played, axis=1)
