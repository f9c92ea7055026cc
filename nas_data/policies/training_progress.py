"""Progress of a study's trainings and remaining time, read from the files of the workers."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from nas_data.count_of import count_of
from nas_data.errors import CheckpointError
from nas_data.policies.compare import Study
from nas_data.policies.policy import read_progress
from nas_data.runs.progress import format_duration, repeating

PAUSE = 10.0  # [s] between two lines of progress


@contextmanager
def report_training_progress(
    study: Study, folder: Path, report: Callable[[str], None], pause: float = PAUSE
) -> Iterator[None]:
    """Report the progress of training every few seconds.

    Args:
        study: The study.
        folder: Folder of its runs.
        report: Called with each line.
        pause: Time between two lines [s].
    """
    folders = [folder / method / f"seed{seed}" for method in study.trained for seed in study.seeds]
    total, first = study.frames * len(folders), count_frames(folders)
    began, before = time.monotonic(), first

    def speak() -> None:
        nonlocal before
        done = min(float(total), count_frames(folders))
        if done > before:
            left = (total - done) / (done - first) * (time.monotonic() - began)
            report(
                f"{count_of(len(folders), 'policy', plural='policies')}: {done / total:.0%} of {total:,} control "
                f"steps, {format_duration(left)} left"
            )
        before = done

    with repeating(speak, pause):
        yield


def count_frames(folders: list[Path]) -> float:
    """Return the number of trained control steps of all policies, as written so far."""
    return sum(count_trained_frames(folder) for folder in folders)


def count_trained_frames(folder: Path) -> float:
    """Return the number of trained control steps of a policy; 0 if it has not begun."""
    try:
        return float(read_progress(folder)["frames"][-1])
    except CheckpointError:
        return 0.0
