"""Jobs of a long command before it runs, with an estimate of their time."""

from collections.abc import Sequence
from dataclasses import dataclass

from nas_data.count_of import count_of
from nas_data.runs.progress import format_duration
from nas_data.text_table import format_table


@dataclass(frozen=True)
class PlannedJob:
    """A job of a long command."""

    name: str
    kind: str  # true and rough time have about the same ratio for all jobs of a kind
    rough: float  # rough time on one core of a desktop computer [s]
    took: float | None = None  # time that it took [s]; 0 if it failed, None if it is not done


def estimate_seconds(job: PlannedJob, jobs: Sequence[PlannedJob]) -> float:
    """Return the expected time of a job [s], corrected by the finished jobs of its kind, or of all kinds."""
    if job.took is not None:
        return job.took
    finished = [other for other in jobs if other.took]
    alike = [other for other in finished if other.kind == job.kind] or finished
    known = sum(other.rough for other in alike)
    return job.rough * sum(other.took or 0.0 for other in alike) / known if known else job.rough


def estimate_rest(jobs: Sequence[PlannedJob], workers: int) -> float:
    """Return the expected time until all jobs are done [s]."""
    waiting = [estimate_seconds(job, jobs) for job in jobs if job.took is None]
    return max(sum(waiting) / workers, max(waiting, default=0.0))


def format_jobs(jobs: Sequence[PlannedJob], workers: int) -> str:
    """Return the jobs as a table, with a sentence on the time that they take."""
    rows = [
        (job.name, "to do" if job.took is None else "done", format_duration(estimate_seconds(job, jobs)))
        for job in jobs
    ]
    done = sum(job.took is not None for job in jobs)
    head = f"{count_of(len(jobs), 'job')}, {done} done"
    if done == len(jobs):
        return "\n".join([format_table(("job", "state", "time"), rows), f"{head}; nothing is left to do."])
    rest = f"{format_duration(estimate_rest(jobs, workers))} with {count_of(workers, 'worker')}"
    basis = (
        f"about {rest}, by the times of finished jobs"
        if done
        else f"roughly {rest} on a desktop computer; the estimate improves when some are done"
    )
    return "\n".join(
        [format_table(("job", "state", "time"), rows), f"{head}; {'the others' if done else 'they'} take {basis}."]
    )


def describe_jobs(jobs: Sequence[PlannedJob], workers: int) -> dict[str, object]:
    """Return the jobs for JSON."""
    return {
        "jobs": [
            {"job": job.name, "done": job.took is not None, "seconds": round(estimate_seconds(job, jobs), 1)}
            for job in jobs
        ],
        "workers": workers,
        "seconds_left": round(estimate_rest(jobs, workers), 1),
    }
