"""Unwrapping of encoders that jump after a whole turn."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from nas_data.dataset.audits.jumps import WHOLE_TURN, find_whole_turns
from nas_data.dataset.recording import Recording


def unwrap(
    recordings: Sequence[Recording], hinges: Collection[str], commanded: Collection[str], centres: Mapping[str, float]
) -> list[Recording]:
    """Return recordings with unwrapped joint positions, none a whole turn away from the others.

    Args:
        recordings: Episodes with the same joints.
        hinges: Names of the hinges; other joints are not changed.
        commanded: Names of hinges with position commands. If such a joint is unwrapped, its commands are moved to
            within half a turn of the positions.
        centres: Middle of the range of joints that have one [rad]; the others stay near the first recording.
    """
    changed = list(recordings)
    for index, joint in enumerate(recordings[0].joints if recordings else ()):
        paths = [recording.positions[:, index] for recording in recordings]
        if joint not in hinges or not any(find_whole_turns(np.diff(path)).any() for path in paths):
            continue
        paths = [np.unwrap(path) for path in paths]
        centre = centres.get(joint, float(paths[0].mean()))
        for place, path in enumerate(paths):
            near = path - WHOLE_TURN * np.round((path.mean() - centre) / WHOLE_TURN)
            changed[place] = _move(changed[place], index, near, joint in commanded)
    return changed


def _move(recording: Recording, index: int, path: np.ndarray, commanded: bool) -> Recording:
    """Return a recording with other positions of a joint, shape (N,), and its commands moved along."""
    positions, commands = recording.positions.copy(), recording.commands.copy()
    positions[:, index] = path
    if commanded:
        commands[:, index] -= WHOLE_TURN * np.round((commands[:, index] - path) / WHOLE_TURN)
    return replace(recording, positions=positions, commands=commands)
