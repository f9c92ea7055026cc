"""Unwrapping of encoders that jump after a whole turn."""

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from nas_data.dataset.audits.jumps import WHOLE_TURN, find_whole_turns
from nas_data.dataset.recording import Recording


def unwrap(recording: Recording, hinges: Collection[str], commanded: Collection[str]) -> Recording:
    """Return a recording with unwrapped joint positions.

    Args:
        recording: One episode.
        hinges: Names of the hinges; other joints are not changed.
        commanded: Names of hinges with position commands. If such a joint is unwrapped, its commands are moved to
            within half a turn of the positions.
    """
    positions, commands = recording.positions.copy(), recording.commands.copy()
    for index, joint in enumerate(recording.joints):
        if joint not in hinges or not find_whole_turns(np.diff(positions[:, index])).any():
            continue
        positions[:, index] = np.unwrap(positions[:, index])
        if joint in commanded:
            commands[:, index] -= WHOLE_TURN * np.round((commands[:, index] - positions[:, index]) / WHOLE_TURN)
    return replace(recording, positions=positions, commands=commands)
