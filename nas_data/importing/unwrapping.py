"""Whole turns at which an encoder begins anew, taken out of a recording."""

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from nas_data.dataset.audits.jumps import WHOLE_TURN, find_whole_turns
from nas_data.dataset.recording import Recording


def unwrap(recording: Recording, hinges: Collection[str], commanded: Collection[str]) -> Recording:
    """Return a recording whose joints go on where their encoders begin anew after a whole turn.

    Args:
        recording: One episode.
        hinges: Names of the joints that turn; the others are left as they are.
        commanded: Names of those that are commanded positions. Their commands are put within half a turn of the
            positions, in joints that turn over.
    """
    positions, commands = recording.positions.copy(), recording.commands.copy()
    for index, joint in enumerate(recording.joints):
        if joint not in hinges or not find_whole_turns(np.diff(positions[:, index])).any():
            continue
        positions[:, index] = np.unwrap(positions[:, index])
        if joint in commanded:
            commands[:, index] -= WHOLE_TURN * np.round((commands[:, index] - positions[:, index]) / WHOLE_TURN)
    return replace(recording, positions=positions, commands=commands)
