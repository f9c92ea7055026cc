"""Unwrapping of encoders and commands that jump after a whole turn."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from nas_data.dataset.audits.jumps import WHOLE_TURN, find_whole_turns
from nas_data.dataset.recording import Recording

FOLLOWED = 0.2  # [rad] towards a new command; deviations of joints that stay near their commands are smaller


def unwrap(
    recordings: Sequence[Recording], hinges: Collection[str], commanded: Collection[str], centres: Mapping[str, float]
) -> list[Recording]:
    """Return recordings with unwrapped joint positions, none a whole turn away from the others.

    Args:
        recordings: Episodes with the same joints.
        hinges: Names of the hinges; other joints are not changed.
        commanded: Names of hinges with position commands. If such a joint is unwrapped, or its commands alone wrap
            around, its commands are moved to within half a turn of the positions.
        centres: Middle of the range of joints that have one [rad]; of the others, recordings that jump are moved near
            those that do not, else near the first one.
    """
    changed = list(recordings)
    for index, joint in enumerate(recordings[0].joints if recordings else ()):
        paths = {place: one.positions[:, index] for place, one in enumerate(recordings) if _is_finite(one)}
        wrapped = {place for place, path in paths.items() if find_whole_turns(np.diff(path)).any()}
        if joint not in hinges or not wrapped:
            continue
        paths = {place: np.unwrap(path) for place, path in paths.items()}
        means = {place: float(path.mean()) for place, path in paths.items()}
        unbroken = [mean for place, mean in means.items() if place not in wrapped] or [means[min(wrapped)]]
        centre = centres.get(joint, float(np.mean(unbroken)))
        for place in paths if joint in centres else wrapped:
            near = paths[place] - WHOLE_TURN * np.round((means[place] - centre) / WHOLE_TURN)
            changed[place] = _move(changed[place], index, near, joint in commanded)
    for index, joint in enumerate(recordings[0].joints if recordings else ()):
        if joint in hinges and joint in commanded:
            _unwrap_commands(changed, index)
    return changed


def _unwrap_commands(recordings: list[Recording], index: int) -> None:
    """Move commands of a joint that wrap around near its positions, in a list of recordings.

    If the commands of one recording wrap, those of others may be whole turns away without a jump.
    """
    moved, wraps = {}, False
    for place, one in enumerate(recordings):
        if not _is_finite(one):
            continue
        path, commands = one.positions[:, index], one.commands[:, index]
        steps, turns = np.diff(commands), np.round((commands - path) / WHOLE_TURN)
        # A joint that is commanded to turn once follows such a step, which brings it near its command without a jump.
        arrives = bool(np.diff(turns)[np.abs(steps) < WHOLE_TURN / 2].any())
        if turns.any() and not arrives and not _follows_jumps(path, commands):
            moved[place] = _move(one, index, path, commanded=True)
            wraps = wraps or bool(find_whole_turns(steps).any())
    for place, one in moved.items() if wraps else ():
        recordings[place] = one


def _follows_jumps(path: np.ndarray, commands: np.ndarray) -> bool:
    """Whether a joint moves towards its new command after a jump of the command, as it does if it is to turn once.

    Where only the command wraps around, the joint goes on in the opposite direction, or stays.

    Args:
        path: Positions [rad], shape (N,).
        commands: Position commands [rad], shape (N,).
    """
    steps = np.diff(commands)
    jumps = np.flatnonzero(np.abs(steps) > WHOLE_TURN / 2)
    ends = np.append(jumps, len(path) - 1)[1:]  # last row of each new command, before the next jump
    return any(
        float((np.sign(steps[jump]) * (path[jump + 1 : end + 1] - path[jump + 1])).max()) > FOLLOWED
        for jump, end in zip(jumps, ends, strict=True)
    )


def _is_finite(recording: Recording) -> bool:
    """Return whether all positions and commands are numbers; an audit names the rows of others."""
    return bool(np.isfinite(recording.positions).all() and np.isfinite(recording.commands).all())


def _move(recording: Recording, index: int, path: np.ndarray, commanded: bool) -> Recording:
    """Return a recording with other positions of a joint, shape (N,), and its commands moved along."""
    positions, commands = recording.positions.copy(), recording.commands.copy()
    positions[:, index] = path
    if commanded:
        commands[:, index] -= WHOLE_TURN * np.round((commands[:, index] - path) / WHOLE_TURN)
    return replace(recording, positions=positions, commands=commands)
