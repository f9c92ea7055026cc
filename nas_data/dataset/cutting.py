"""Division of episodes in time: at gaps in the measurement, or at regular intervals."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from nas_data.count_of import count_of
from nas_data.dataset.audits.timing import find_holes
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import TIME
from nas_data.errors import OptionError

SHORTEST = 3  # frames; two transitions


def find_gaps(dataset: Dataset) -> list[tuple[int, float]]:
    """Return the frames that follow a gap in the recorder's clock, and the length of each gap [s]."""
    if TIME not in dataset.columns:
        return []
    time, found = dataset.columns[TIME][:, 0], []
    for frames in dataset.episodes():
        steps = np.diff(time[frames])
        if not len(steps) or not np.isfinite(steps).all() or not (steps >= 0).all() or not steps.any():
            continue
        period = max(1 / dataset.fps, float(np.median(steps[steps > 0])))
        found += [
            (frames.start + int(place) + 1, float(steps[place])) for place in np.flatnonzero(find_holes(steps, period))
        ]
    return found


def cut_every(dataset: Dataset, seconds: float) -> Dataset:
    """Cut episodes into parts of a given length [s]; the remainder stays with the last part.

    Raises:
        OptionError: the length is no number, the parts would be shorter than three frames, or no episode is as long as
            two of them.
    """
    if not np.isfinite(seconds * dataset.fps):
        raise OptionError(f"The length of a segment is {seconds:g} s; give a number of seconds, such as 3.")
    size = round(seconds * dataset.fps)
    if size < SHORTEST:
        raise OptionError(
            f"Segments of {seconds:g} s have {count_of(max(size, 0), 'frame')} at {dataset.fps:g} Hz; give at least "
            f"{SHORTEST / dataset.fps:.2g} s."
        )
    starts = [
        start for frames in dataset.episodes() for start in range(frames.start + size, frames.stop - size + 1, size)
    ]
    if not starts:
        most = int(dataset.lengths.max())
        raise OptionError(
            f"No episode is long enough for two segments of {seconds:g} s; the longest has {most / dataset.fps:.4g} s: "
            "give at "
            f"most {most // 2 / dataset.fps:.4g} s."
        )
    return cut_at(dataset, starts)


def cut_at(dataset: Dataset, frames: Sequence[int]) -> Dataset:
    """Begin a new episode at each given frame, with the clock at zero."""
    starts = np.union1d(dataset.starts, np.asarray(frames, np.int64)).astype(np.int64)
    cut = replace(dataset, lengths=np.diff(np.append(starts, dataset.n_frames)))
    episodes = find_original_episodes(dataset, cut)
    cut = replace(cut, tasks=tuple(dataset.tasks[episode] for episode in episodes), numbers=())
    if TIME not in dataset.columns:
        return cut
    time = dataset.columns[TIME]
    first = (
        time[starts] - time[dataset.starts[episodes]]
    )  # relative to the episode's first time, which need not be zero
    return cut.with_column(TIME, dataset.features[TIME], time - np.repeat(first, cut.lengths, axis=0))


def find_original_episodes(dataset: Dataset, cut: Dataset) -> list[int]:
    """Return for each part of a dataset that was cut in time the episode that it belonged to."""
    return (np.searchsorted(dataset.starts, cut.starts, side="right") - 1).tolist()
