"""Gaps: holes in a log's time, at which it is divided because nothing was measured in them."""

from dataclasses import replace
from itertools import pairwise

import numpy as np

from nas_data.dataset.audits.timing import find_holes
from nas_data.dataset.recording import Recording


def divide(recording: Recording, rate: float) -> list[Recording]:
    """Divide a recording where rows are missing; a transition over a hole would be a robot that leaps.

    Args:
        recording: Episode as it was recorded.
        rate: The map's rate [Hz]; where rows come more slowly, their median step counts.

    Returns:
        Parts between the holes, as episodes numbered from 1; the recording itself where there is none.
    """
    steps = np.diff(recording.time)
    # A time that goes back or stands still makes holes of its own; the timing audit refuses it.
    if not (steps >= 0).all() or not steps.any():
        return [recording]
    period = max(1 / rate, float(np.median(steps[steps > 0])))
    holes = np.flatnonzero(find_holes(steps, period)) + 1
    if not holes.size:
        return [recording]
    edges = [0, *holes.tolist(), len(recording)]
    name = f"{recording.episode}." if recording.episode else ""
    gaps = [0.0, *steps[holes - 1].tolist()]
    return [
        replace(recording.take(slice(start, stop)), episode=f"{name}{number}", gap=gap)
        for number, (gap, (start, stop)) in enumerate(zip(gaps, pairwise(edges), strict=True), start=1)
    ]
