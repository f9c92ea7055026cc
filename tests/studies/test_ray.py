"""Sweeps on a Ray cluster of this machine: what a cluster does is what this machine would have done."""

import os
import sys
from pathlib import Path

import pytest
import ray
from support.command_samples import nas
from support.sweep_samples import BRIEF, answers, planned, silent

from nas_data.errors import MissingPackage, UnknownName, WorkerLost
from nas_data.runs.executors import find_workers
from nas_data.runs.executors import ray as executor
from nas_data.runs.parallel import ONE_WORKER, run_jobs
from nas_data.studies.ablation.sweep import run_sweep
from nas_data.studies.ablation.sweep_data import Amount

pytestmark = pytest.mark.timeout(180)


@pytest.fixture(scope="module", autouse=True)
def cluster():
    """A cluster of two cores, which the tests share; it cannot import this file, whose functions travel as they are."""
    ray.cloudpickle.register_pickle_by_value(sys.modules[__name__])
    ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False, logging_level="error")
    yield
    ray.shutdown()


def half(number: int) -> int:
    if number == 3:
        raise UnknownName("number", "3", ["1", "2"])
    return number // 2


def where(_: int) -> tuple[str, str]:
    return str(Path.cwd()), os.environ["OMP_NUM_THREADS"]


def end(_: int) -> None:
    os._exit(1)


def test_a_job_that_fails_does_not_end_the_others_and_says_what_was_wrong():
    found = {}
    with pytest.raises(UnknownName, match="There is no number '3'; choose one of: 1, 2"):
        for number, result in run_jobs(half, range(6), find_workers("ray", 2)):
            found |= {number: result}
    assert found == {0: 0, 1: 0, 2: 1, 4: 2, 5: 2}


def test_a_job_waits_for_those_that_it_builds_on():
    order = [number for number, _ in run_jobs(half, [0, 1, 2], find_workers("ray", 2), {0: [2], 1: [2]})]
    assert order[0] == 2 and set(order) == {0, 1, 2}


def test_jobs_run_in_the_folder_of_the_sweep_on_one_thread(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert dict(run_jobs(where, [0], find_workers("ray", 1))) == {0: (str(tmp_path), "1")}


def test_a_machine_without_the_folder_is_named_for_it():
    with pytest.raises(WorkerLost, match="no folder /nowhere/at/all"):
        executor.run_in(half, 2, "/nowhere/at/all")


@pytest.mark.slow
def test_a_trial_whose_process_dies_is_told_in_one_sentence():
    with pytest.raises(WorkerLost, match=r"^Ray lost a job \(.*\); finished work is kept: run it again\.$"):
        list(run_jobs(end, [0], find_workers("ray", 1)))


@pytest.mark.slow
def test_a_sweep_on_the_cluster_finds_what_it_finds_here(place, tmp_path):
    brief = {"kinds": ("forward",), "amounts": (Amount(2, "episodes"), Amount(3, "episodes"))}
    for name, workers in (("here", ONE_WORKER), ("cluster", find_workers("ray", 2))):
        run_sweep(planned(place, tmp_path / name, **brief), workers, False, silent)
    assert len(answers(tmp_path / "cluster")) == 2
    assert answers(tmp_path / "cluster") == answers(tmp_path / "here")


def test_without_ray_the_remedy_is_said(place, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(MissingPackage, match=r"pip install 'nas_data\[ray\]'"):
        list(run_jobs(half, [0], find_workers("ray", 1)))
    monkeypatch.chdir(tmp_path)
    answer = nas("ablate", place.paired, *BRIEF, "--counts", "2", "--seeds", "0", "--executor", "ray")
    assert answer.code == 2 and "Traceback" not in answer.err
    assert answer.err.splitlines()[-1] == "nas: The executor ray needs Ray: pip install 'nas_data[ray]'"
