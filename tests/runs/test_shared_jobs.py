"""Jobs that several processes share over lock files, and the list of jobs before they run."""

import errno
import logging
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from pathlib import Path

import pytest
from support.command_samples import done
from support.stage_samples import write_and_wait

from nas_data.errors import OptionError, OutputExists, UnknownName
from nas_data.runs import parallel
from nas_data.runs.executors import find_workers
from nas_data.runs.job_locks import JobLocks, hold_run, list_locks
from nas_data.runs.parallel import ONE_WORKER, run_jobs
from nas_data.runs.planned_jobs import PlannedJob, describe_jobs, estimate_seconds, format_jobs

SHARED = find_workers("folder", 1)


@pytest.fixture
def locks(tmp_path) -> list[Path]:
    return list_locks(tmp_path, ["a/seed0", "a/seed1", "b"])


def test_a_job_that_another_process_does_is_done_last_and_waited_for(locks, monkeypatch):
    monkeypatch.setattr(parallel, "PAUSE", 0.01)
    (other := JobLocks(locks)).take(0)
    jobs = run_jobs(abs, [-1, -2, -3], SHARED, locks=locks)
    assert [next(jobs), next(jobs)] == [(1, 2), (2, 3)]
    ended: list[tuple[int, int]] = []
    with listening() as said:
        waiting = threading.Thread(target=lambda: ended.extend(jobs))
        waiting.start()
        time.sleep(0.2)
        assert not ended
        other.release_all()
        waiting.join(10)
    assert ended == [(0, 1)]
    assert said == [f"waiting for 1 job: a/seed0 (process {os.getpid()} on {socket.gethostname()})"]


@contextmanager
def listening():
    """Collect what is logged."""
    said: list[str] = []
    handler = logging.Handler()
    handler.emit = lambda record: said.append(record.getMessage())
    parallel.logger.addHandler(handler)
    yield said
    parallel.logger.removeHandler(handler)


def test_what_builds_on_a_job_of_another_process_waits_for_it(locks, monkeypatch):
    monkeypatch.setattr(parallel, "PAUSE", 0.01)
    (other := JobLocks(locks)).take(0)
    jobs = run_jobs(abs, [-1, -2, -3], SHARED, {1: [0]}, locks)
    assert next(jobs) == (2, 3)
    other.release_all()
    assert list(jobs) == [(0, 1), (1, 2)]


def test_a_process_works_alone_or_shares(locks, tmp_path):
    """Whoever comes later is refused, before it does anything."""
    numbers = [-1, -2, -3]
    (other := JobLocks(locks)).take(1)
    with pytest.raises(OutputExists, match=rf"Another process works in {tmp_path} \(process .*; join it with --join"):
        next(run_jobs(abs, numbers, ONE_WORKER, locks=locks))
    other.release_all()
    alone = run_jobs(abs, numbers, ONE_WORKER, locks=locks)
    next(alone)
    assert "begun without --executor folder" in share_elsewhere(tmp_path)
    assert list(alone) == [(1, 2), (2, 3)]
    assert [file.name for file in tmp_path.rglob("*.lock")] == ["seed1.lock"], "that of the shared run"


def share_elsewhere(folder: Path) -> str:
    """Return what another process is told that would share a run."""
    code = f"""
from pathlib import Path
from nas_data.runs.job_locks import hold_run
with hold_run(Path({str(folder)!r}), shared=True):
    pass
"""
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False).stderr


def test_a_run_may_be_held_in_itself(tmp_path):
    with hold_run(tmp_path):
        with hold_run(tmp_path):
            pass
        assert "OutputExists" in share_elsewhere(tmp_path)
    assert not list(tmp_path.iterdir())
    assert share_elsewhere(tmp_path) == ""


@pytest.mark.parametrize("jobs", [["1", "one", "3"], ["1", "2", "3"]])
def test_no_job_stays_locked_after_a_run(locks, jobs):
    try:
        list(run_jobs(int, jobs, SHARED, locks=locks))
    except ValueError:
        assert "one" in jobs
    other = JobLocks(locks)
    assert all(other.take(number) for number in range(3))
    other.release_all()


def test_running_jobs_end_before_they_are_released(tmp_path):
    """An interrupt of this process only: its workers must not go on beside those who take the jobs over."""
    folder = tmp_path / "run"
    shared = find_workers("folder", 2)
    jobs = run_jobs(write_and_wait, [(tmp_path, name) for name in "abc"], shared, locks=list_locks(folder, "abc"))
    with pytest.raises(KeyboardInterrupt):
        interrupt(jobs, lambda: (tmp_path / "a").exists() and (tmp_path / "b").exists())
    ids = [int((tmp_path / name).read_text()) for name in "ab"]
    assert not any(Path(f"/proc/{pid}").exists() for pid in ids)
    assert not (tmp_path / "c").exists()


def interrupt(jobs, is_begun) -> None:
    """Interrupt this thread while it waits for jobs."""

    def send() -> None:
        while not is_begun():
            time.sleep(0.05)
        os.kill(os.getpid(), signal.SIGINT)

    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background processes ignore it
    threading.Thread(target=send).start()
    try:
        next(jobs)
    finally:
        signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize("number", [errno.ENOSYS, errno.ENOLCK])
def test_a_disk_without_locks_serves_one_process_only(locks, monkeypatch, number):
    """Such as Lustre that is mounted without flock."""

    def refuse(*_):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr("fcntl.flock", refuse)
    assert dict(run_jobs(abs, [-1, -2, -3], ONE_WORKER, locks=locks)) == {0: 1, 1: 2, 2: 3}
    with pytest.raises(OptionError, match="--executor folder needs file locks, which the disk of"):
        list(run_jobs(abs, [-1, -2, -3], SHARED, locks=locks))


def test_an_unknown_executor_is_answered_with_all():
    with pytest.raises(UnknownName, match="There is no executor 'moon'; choose one of: folder, local, ray"):
        find_workers("moon", 1)


@pytest.mark.parametrize(
    ("command", "count"),
    [
        (("policy", "train", "--seed", "0", "1"), 2),
        (("policy", "compare", "--seed", "0", "1"), 4),
        (("benchmark", "gap", "--families", "none,outside_one", "--cases", "2"), 8),
        (("experiment", "figure8", "--quick"), 13),
    ],
)
def test_a_dry_run_lists_the_jobs_and_writes_nothing(tmp_path, monkeypatch, command, count):
    monkeypatch.chdir(tmp_path)
    found = done(*command, "--dry-run", "--workers", "2", "--json").json
    assert len(found["jobs"]) == count and not any(job["done"] for job in found["jobs"])
    assert found["seconds_left"] == pytest.approx(sum(job["seconds"] for job in found["jobs"]) / 2, rel=0.01)
    assert f"{count} jobs, 0 done; they take roughly" in done(*command, "--dry-run").out
    assert not list(tmp_path.iterdir())


def test_the_times_of_jobs_come_from_finished_ones_of_their_kind():
    jobs = [
        PlannedJob("slow, done", "slow", 100.0, 300.0),
        PlannedJob("slow", "slow", 200.0),
        PlannedJob("fast, done", "fast", 10.0, 5.0),
        PlannedJob("fast", "fast", 20.0),
        PlannedJob("other", "other", 110.0),
    ]
    assert [estimate_seconds(job, jobs) for job in jobs] == pytest.approx([300, 600, 5, 10, 110 * 305 / 110])
    assert describe_jobs(jobs, 2)["seconds_left"] == 600, "not before its longest job"
    assert describe_jobs(jobs, 1)["seconds_left"] == 915
    assert "5 jobs, 2 done; the others take about 15 min with 1 worker, by the times of finished" in format_jobs(
        jobs, 1
    )
    assert "roughly 5 min with 1 worker on a desktop" in format_jobs([jobs[1], jobs[4]], 1)
    assert format_jobs(jobs[:1], 1).endswith("1 job, 1 done; nothing is left to do.")
    assert format_jobs([], 1).endswith("nothing is left to do.")
