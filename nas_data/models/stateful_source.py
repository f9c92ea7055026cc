"""Predictions of a source with unmeasured state (play, a delayed setpoint) that is kept along recorded motions."""

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import SIM_STATE, make_state_feature
from nas_data.models.episodes import Episode
from nas_data.pairing import read_scene_states
from nas_data.simulators.base import Simulator, Stepper

BATCH = 64  # episodes stepped together


def predict_with_memory(dataset: Dataset, simulator: Simulator) -> Dataset:
    """Return a dataset with predictions of a source that is set, but not reset, to each measured state.

    φ in a closed loop is equivalent: it corrects the measured joints only.
    """
    predicted = np.empty_like(dataset.states)
    episodes = list(dataset.episodes())
    for first in range(0, len(episodes), BATCH):
        starts = np.array([rows.start for rows in episodes[first : first + BATCH]])
        lengths = np.array([rows.stop - rows.start for rows in episodes[first : first + BATCH]])
        stepper = simulator.stepper(len(starts))
        stepper.reset(read_scene_states(dataset, simulator, starts).astype(float))
        for step in range(lengths.max()):
            rows = starts + np.minimum(step, lengths - 1)
            after = step_from(stepper, dataset.states[rows], dataset.commands[rows])
            predicted[rows[step < lengths]] = after[step < lengths]
    return dataset.with_column(SIM_STATE, make_state_feature(dataset.joints, dataset.slides), predicted)


def start_at_windows(simulator: Simulator, episodes: Sequence[Episode], starts: np.ndarray, longest: int) -> Stepper:
    """Return simulations at the starts of windows, after they followed the measured states before.

    Args:
        simulator: Source.
        episodes: Episode of each of W windows.
        starts: First frame of each window, shape (W,).
        longest: Most frames to follow before a window.
    """
    stepper = simulator.stepper(len(episodes))
    runs = np.minimum(starts, longest)
    scenes = [torch.cat([episode.states, episode.objects], dim=1) for episode in episodes]
    first = gather_frames(scenes, starts - runs)
    stepper.reset(first)
    for step in range(runs.max() - 1, -1, -1):
        waiting = np.flatnonzero(runs <= step)  # windows whose frames have not begun
        frames = starts - np.minimum(runs, step + 1)
        states, commands = ([getattr(episode, name) for episode in episodes] for name in ("states", "commands"))
        step_from(stepper, gather_frames(states, frames), gather_frames(commands, frames))
        if len(waiting):
            stepper.reset(first[waiting], waiting)
    return stepper


def step_from(stepper: Stepper, states: np.ndarray, commands: np.ndarray) -> np.ndarray:
    """Step once from measured states (B, 2n), with unmeasured state kept; return the next states (B, 2n)."""
    stepper.set_states(states.astype(float))
    return stepper.step(commands.astype(float))


def gather_frames(columns: Sequence[Tensor], frames: np.ndarray) -> np.ndarray:
    """Return one frame of each column, shape (W, …), float64."""
    return np.stack([column[frame].double().numpy() for column, frame in zip(columns, frames, strict=True)])
