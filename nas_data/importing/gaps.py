"""Division of a log at gaps in its time."""

from dataclasses import replace
from itertools import pairwise

import numpy as np

from nas_data.dataset.audits.timing import find_holes
from nas_data.dataset.recording import Recording


def divide(recording: Recording, rate: float) -> list[Recording]:
    """Divide a recording where rows are missing: a transition across a gap would be a jump.

    Args:
        recording: Episode as recorded.
        rate: The map's rate [Hz]; the median step counts if rows come more slowly.

    Returns:
        Parts between the gaps, as episodes numbered from 1; the recording itself if there is no gap.
    """
    steps = np.diff(recording.time)
    # Time that goes back or stands still also looks like a gap; the timing audit refuses it.
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
