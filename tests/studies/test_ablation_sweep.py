"""Sweeps: the same question has the same answer, none is answered twice, and a killed sweep goes on."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.command_samples import SIMULATED, done, nas
from support.recording_samples import GAP, pendulum, recorded_on, wander
from support.sweep_samples import BRIEF, TINY, answers, planned, silent
from support.training_samples import same
from support.two_joint_arm import ARM, recorded

from nas_data.dataset.read import read
from nas_data.dataset.versions import write_version
from nas_data.effects.base import parse
from nas_data.errors import DatasetInvalid, OutputExists, WorkerLost
from nas_data.gap.write_model import write_effects
from nas_data.models.split import select_frames, split_validation
from nas_data.runs.environment_info import find_commit
from nas_data.runs.job_locks import JobLocks, list_locks
from nas_data.runs.parallel import ONE_WORKER, run_jobs
from nas_data.studies.ablation import sweep as sweeping
from nas_data.studies.ablation import trial as trials
from nas_data.studies.ablation.evaluation import TrialResult
from nas_data.studies.ablation.kinds.base import TrainingInput, find_kind
from nas_data.studies.ablation.sweep import run_sweep
from nas_data.studies.ablation.sweep_data import Amount, SweepData, divide, draw
from nas_data.studies.ablation.trial import UNFINISHED, do_trial
from nas_data.typed_json import from_json

SAMPLE = Path(__file__).parents[2] / "datasets/ergojr_sample"


# trials


def test_seeds_come_one_after_the_other_and_in_each_long_trials_first(place, tmp_path):
    configs = [trial.config for trial in planned(place, tmp_path, seeds=(3, 1))]
    assert [config.seed for config in configs] == [3] * 6 + [1] * 6
    for half in (configs[:6], configs[6:]):
        amounts = [config.amount for config in half]
        assert amounts == sorted(amounts, reverse=True)
        assert len({(config.kind, config.amount) for config in half}) == 6


def test_the_same_question_has_the_same_answer_to_the_last_bit(place, tmp_path):
    for name in ("one", "other"):
        for trial in planned(place, tmp_path / name, amounts=(Amount(4, "episodes"),)):
            do_trial(trial)
    assert len(answers(tmp_path / "one")) == 2
    assert answers(tmp_path / "one") == answers(tmp_path / "other")


def test_a_result_tells_all_that_it_depends_on_and_all_errors(place, tmp_path):
    (trial,) = planned(place, tmp_path, kinds=("delta",), amounts=(Amount(3, "episodes"),), seeds=(5,))
    result = do_trial(trial)
    record = json.loads(trial.path.read_text())
    assert from_json(TrialResult, record) == result
    config, content = record["question"]["config"], record["question"]["content"]
    assert (config["kind"], config["amount"], config["unit"], config["seed"]) == ("delta", 3, "episodes", 5)
    assert config["options"]["seed"] == 5 and config["options"]["updates"] == 2
    assert len(content["dataset"]) == len(content["source"]) == 64
    assert record["packages"]["torch"] and record["wall_seconds"] > 0 < record["cpu_seconds"]
    for loop in ("one_step", "open_loop"):
        assert set(record[loop]) == {"delta", "source", "hold", "command"}
        assert set(record[loop]["delta"]) >= {"overall", "mean_of_episodes", "per_joint", "per_episode"}
        assert len(record[loop]["delta"]["per_episode"]) == 2


def test_a_key_depends_on_every_part_of_the_question_and_not_on_places(place, tmp_path):
    (trial,) = planned(place, tmp_path, kinds=("delta",), amounts=(Amount(3, "episodes"),))
    config, content = trial.config, trial.content
    others = [
        replace(trial, config=replace(config, kind="forward")),
        replace(trial, config=replace(config, amount=Amount(3, "minutes"))),
        replace(trial, config=replace(config, seed=1)),
        replace(trial, config=replace(config, held_out=0.3)),
        replace(trial, config=replace(config, options=replace(TINY, updates=3))),
        replace(trial, content=replace(content, dataset="0" * 64)),
        replace(trial, content=replace(content, test="0" * 64)),
        replace(trial, content=replace(content, source="0" * 64)),
        replace(trial, code="0" * 64),
    ]
    assert len({trial.key, *(other.key for other in others)}) == 1 + len(others)
    moved = replace(trial, folder=tmp_path / "b", material=replace(trial.material, root=Path("elsewhere")))
    assert moved.key == trial.key
    given = replace(trial, content=replace(content, effects="0" * 64))
    assert given.key == trial.key, "φ of the plain source knows nothing of named effects"
    assert replace(given, config=replace(config, kind="named")).key != given.key


@pytest.mark.parametrize("kind", ["delta", "forward"])
def test_normalisation_and_weights_know_nothing_of_what_is_not_in_the_subset(place, tmp_path, kind):
    dataset, amount = read(place.paired), Amount(2, "episodes")
    train, held = divide(dataset.n_episodes, 0.2, 0)
    runs = draw(dataset, train, amount, 0)
    inside = np.zeros(dataset.n_frames, bool)
    for start, stop in runs:
        inside[start:stop] = True
    spoilt = replace(dataset, columns={k: np.where(inside[:, None], v, 7 * v + 1) for k, v in dataset.columns.items()})
    learned = []
    for name, data in (("as recorded", dataset), ("spoilt", spoilt)):
        (folder := tmp_path / name).mkdir()
        subset = select_frames(data, draw(data, divide(data.n_episodes, 0.2, 0)[0], amount, 0))
        lesson = TrainingInput(subset, place.paired, SweepData(place.paired).source(), None, TINY, folder)
        learned.append(find_kind(kind).learn(lesson).model)
    assert same(*learned)
    own = split_validation(select_frames(dataset, runs), TINY.validation, 0).train
    np.testing.assert_allclose(learned[0].input_mean[:2], own.states.mean(0), atol=1e-6)
    assert held and not np.allclose(learned[0].input_mean[:2], dataset.states.mean(0), atol=1e-3)


def test_all_trials_of_a_seed_meet_the_same_held_out_episodes(place, tmp_path):
    few = (Amount(2, "episodes"), Amount(4, "episodes"))
    results = [(trial.config.seed, do_trial(trial)) for trial in planned(place, tmp_path, amounts=few, seeds=(0, 1))]
    by_seed = {seed: [result for other, result in results if other == seed] for seed in (0, 1)}
    for loop in ("one_step", "open_loop"):
        for baseline in ("source", "hold", "command"):
            told = {seed: {json.dumps(r.predictors(loop)[baseline]) for r in found} for seed, found in by_seed.items()}
            assert len(told[0]) == len(told[1]) == 1
            assert told[0] != told[1]


def test_results_by_other_code_are_not_used_and_not_removed(place, tmp_path, edited):
    told = []
    swept = planned(place, tmp_path, amounts=(Amount(2, "episodes"),))
    first = run_sweep(swept, ONE_WORKER, False, told.append)
    assert all(result.commit == find_commit() for result in first)
    assert all(len(trial.code) == 64 for trial in swept)
    edited("nas_data.models.training", "class ModelTraining", "class Renamed")
    again = planned(place, tmp_path, amounts=(Amount(2, "episodes"),))
    assert not {trial.path for trial in swept} & {trial.path for trial in again}
    second = run_sweep(again, ONE_WORKER, False, told.append)
    assert "2 of these trials have results of another version of nas_data, which are kept but not used" in told
    assert len(answers(tmp_path)) == 4
    assert run_sweep(again, ONE_WORKER, False, told.append) == second


def test_only_code_that_decides_a_kind_makes_its_trials_other_ones(place, tmp_path, edited):
    def codes():
        kinds = ("delta", "forward", "named", "named_delta")
        return {trial.config.kind: trial.code for trial in planned(place, tmp_path, kinds=kinds)}

    before = codes()

    def changed(module, name):
        edited(module, name, f"{name}1")
        return {kind for kind, code in codes().items() if code != before[kind]}

    every = {"delta", "forward", "named", "named_delta"}
    assert changed("nas_data.studies.ablation.sweep_data", "def draw") == every
    assert changed("nas_data.simulators.mujoco", "class MujocoSimulator") == every
    assert changed("nas_data.gap.name", "def name") == {"named", "named_delta"}
    assert changed("nas_data.effects.deadband", "half_width") == {"named", "named_delta"}
    assert changed("nas_data.models.fitting", "def prepare") == every - {"named"}
    assert changed("nas_data.studies.ablation.write", "def format_table") == set()


def test_a_worker_with_other_code_than_the_sweep_does_nothing(place, tmp_path):
    trial = planned(place, tmp_path)[0]
    with pytest.raises(WorkerLost, match="another version of nas_data than that"):
        do_trial(replace(trial, code="0" * 64))
    assert not list(tmp_path.rglob("*.json"))


def test_data_that_change_while_a_sweep_runs_are_noticed(place, tmp_path):
    trial = planned(place, tmp_path)[0]
    with pytest.raises(DatasetInvalid, match="changed while it ran"):
        do_trial(replace(trial, content=replace(trial.content, dataset="0" * 64)))
    assert not trial.path.exists()


# sweeps


def test_no_trial_is_done_twice_and_a_sweep_can_grow(place, tmp_path, monkeypatch):
    asked = []

    def counting(function, jobs, workers, locks):
        asked.append([trial.key for trial, _ in jobs])
        return run_jobs(function, jobs, workers, locks=locks)

    monkeypatch.setattr(sweeping, "run_jobs", counting)
    few = {"amounts": (Amount(2, "episodes"),)}
    first = run_sweep(planned(place, tmp_path, **few), ONE_WORKER, False, silent)
    again = run_sweep(planned(place, tmp_path, **few), ONE_WORKER, False, silent)
    grown = run_sweep(planned(place, tmp_path, **few, seeds=(0, 1)), ONE_WORKER, False, silent)
    assert [len(keys) for keys in asked] == [2, 0, 2]
    assert not set(asked[0]) & set(asked[2])
    assert first == again == grown[:2]


def test_a_result_that_cannot_be_trusted_is_made_again(place, tmp_path):
    waiting = planned(place, tmp_path, kinds=("forward",))
    run_sweep(waiting, ONE_WORKER, False, silent)
    before = answers(tmp_path)
    waiting[0].path.write_text('{"question": ')
    waiting[1].path.write_text(waiting[2].path.read_text())
    run_sweep(waiting, ONE_WORKER, False, silent)
    assert answers(tmp_path) == before


@pytest.mark.slow
def test_two_workers_give_the_same_results_as_one(place, here):
    command = ("ablate", place.paired, "--counts", "2,4", "--seeds", "0", *BRIEF)
    done(*command, "--out", "one")
    done(*command, "--workers", "2", "--out", "two")
    assert len(answers(Path("one"))) == 4
    assert answers(Path("one")) == answers(Path("two"))
    kinds = [json.loads(Path(f"{name}/ablation.json").read_text())["kinds"] for name in ("one", "two")]
    assert kinds[0] == kinds[1]


@pytest.mark.slow
def test_a_killed_sweep_goes_on_and_leaves_no_process_behind(place, here):
    options = ["--kinds", "forward", "--counts", "2,3,4", "--seeds", "0,1", *BRIEF]
    command = [sys.executable, "-m", "nas_data", "ablate", str(place.paired), *options, "--out", "run"]
    root = Path(__file__).parents[2]
    environment = {**os.environ, "PYTHONPATH": str(root)}
    running = subprocess.Popen([*command, "--workers", "2"], env=environment, stderr=subprocess.PIPE, text=True)
    until(lambda: len(list(Path("run/trials").glob("*.json"))) >= 3)
    workers = children(running.pid)
    running.send_signal(signal.SIGKILL)
    running.wait()
    until(lambda: not any(Path(f"/proc/{pid}").exists() for pid in workers))
    before = {path: path.stat().st_mtime_ns for path in Path("run/trials").glob("*.json")}
    assert workers and 3 <= len(before) < 6
    answer = done("ablate", place.paired, *options, "--out", "run")
    assert f"{len(before)} of 6 trials were done before" in answer.err
    assert all(path.stat().st_mtime_ns == when for path, when in before.items())
    assert not Path("run", UNFINISHED).exists()
    done("ablate", place.paired, *options, "--out", "whole")
    assert answers(Path("run")) == answers(Path("whole"))
    assert len(answers(Path("run"))) == 6


def until(true, patience: float = 200.0) -> None:
    """Wait for something."""
    begun = time.monotonic()
    while not true():
        assert time.monotonic() - begun < patience
        time.sleep(0.02)


def children(pid: int) -> set[int]:
    """Return the processes that a process started and that still run."""
    parents = {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            parents[int(path.parent.name)] = int(path.read_text().rpartition(")")[2].split()[1])
        except OSError:
            continue
    return {child for child, parent in parents.items() if parent == pid}


def test_a_failed_trial_is_recorded_with_its_sentence_and_can_be_retried(place, here, monkeypatch):
    command = ("ablate", place.paired, "--kinds", "named", "--counts", "1", "--seeds", "0", "--out", "run")
    answer = nas(*command)
    assert answer.code == 1
    assert "failed: named, 1 episode, seed 0:" in answer.out and "1 episode; at least two are needed" in answer.out
    (record,) = answers(Path("run")).values()
    assert "at least two are needed" in record["failed"]
    done_again = []
    monkeypatch.setattr(trials, "train_and_evaluate", lambda *_: done_again.append(1) or TrialResult(failed="Again."))
    assert "1 of them failed; --retry does them again" in nas(*command).err
    assert not done_again
    assert "Again." in nas(*command, "--retry").out
    assert done_again


def test_a_fault_of_ours_ends_one_trial_and_keeps_its_traceback(place, tmp_path, monkeypatch):
    waiting = planned(place, tmp_path, kinds=("forward",))
    plain = trials.train_and_evaluate

    def faulty(trial, folder):
        return plain(trial, folder) if trial is not waiting[1] else {}["friction"]

    monkeypatch.setattr(trials, "train_and_evaluate", faulty)
    results = run_sweep(waiting, ONE_WORKER, False, silent)
    assert [result.failed for result in results] == [None, "KeyError: 'friction'.", None]
    assert "faulty" in "".join(results[1].traceback)


# what is asked for


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (("--counts", "7"), "--counts asks for 7 episodes, but 6 training episodes hold 6 episodes (of 8 recorded"),
        (("--minutes", "3"), "--minutes asks for 3 minutes, but 6 training episodes hold 0.12 minutes"),
        (("--counts", "2", "--minutes", "1"), "either --counts or --minutes"),
        (("--counts", "few"), "--counts has 'few'"),
        (("--kinds", "delta,magic"), "There is no kind 'magic'; choose one of: delta, forward, named, named_delta."),
        (("--kinds", ","), "--kinds is empty; give some of delta, forward"),
        (("--minutes", ","), "--minutes is empty"),
        (("--executor", "moon"), "There is no executor 'moon'"),
        (("--seeds", "0,0"), "--seeds are 0, 0"),
        (("--seeds", "one"), "--seeds are one"),
        (("--held-out", "1.5"), "--held-out is 1.5"),
        (("--workers", "0"), "--workers is 0"),
        (("--join",), "There is no run in runs/ablation to join; begin it with --executor folder"),
        (("--join", "--executor", "ray"), "--join joins a run of --executor folder, not of ray"),
        (("--test", "."), "There is no dataset at"),
        (("--model", "ergojr"), "pendulum"),
        (("--kinds", "named", "--effects", "nowhere"), "nowhere"),
        (("--updates", "-1"), "must not be negative"),
        (("--preset", "slow"), "There is no preset 'slow'; choose one of: fast, few, paper, stiction, symmetric."),
    ],
)
def test_bad_input_is_one_sentence_and_writes_nothing(place, here, options, sentence):
    answer = nas("ablate", place.paired, *options)
    assert answer.code == 2
    assert sentence in answer.err
    assert "Traceback" not in answer.err and answer.err.count("\n") == 1
    assert not list(Path().iterdir())


def test_an_unpaired_dataset_cannot_teach_phi_and_a_source_is_asked_for(place, here):
    answer = nas("ablate", place.raw, "--counts", "2")
    assert answer.code == 2 and "The kind delta learns from" in answer.err and "nas pair" in answer.err
    answer = nas("ablate", place.raw, "--counts", "2", "--kinds", "named")
    assert answer.code == 2 and "stores none; give --model" in answer.err
    content = done("ablate", place.raw, "--counts", "2", "--kinds", "forward", "--seeds", "0", *BRIEF, "--json").json
    assert set(content["baselines"]) == {"hold", "command"}


def test_a_folder_of_another_sweep_or_of_anything_else_is_refused(place, here):
    command = ("ablate", place.paired, "--kinds", "forward", "--seeds", "0", *BRIEF, "--out", "run")
    done(*command, "--counts", "2")
    before = answers(Path("run"))
    answer = nas(*command, "--counts", "2", "--updates", "3")
    assert answer.code == 2 and "run holds another sweep (option updates: 2 there, 3 here)" in answer.err
    answer = nas(*command, "--minutes", "0.05")
    assert answer.code == 2 and "unit: episodes there, minutes here" in answer.err
    assert answers(Path("run")) == before
    Path("notes").mkdir()
    Path("notes/mine.txt").write_text("mine")
    answer = nas(*command[:-1], "notes")
    assert answer.code == 2 and "notes exists and is not a sweep" in answer.err
    assert [path.name for path in Path("notes").iterdir()] == ["mine.txt"]


def test_a_lone_process_does_not_do_the_trial_of_another(place, tmp_path):
    swept = planned(place, tmp_path, kinds=("forward",))
    (other := JobLocks(list_locks(tmp_path, [swept[2].key]))).take(0)
    with pytest.raises(
        OutputExists, match=r"Another process works in .*; join it with --join, or choose another --out"
    ):
        run_sweep(swept, ONE_WORKER, False, silent)
    assert not answers(tmp_path), "before any trial is done"
    other.release_all()
    assert len(run_sweep(swept, ONE_WORKER, False, silent)) == 3


def test_a_trial_that_another_process_did_meanwhile_is_read(place, tmp_path, monkeypatch):
    """The other process finishes each trial just before this one would begin it."""
    swept = planned(place, tmp_path, kinds=("forward",))
    monkeypatch.setattr(sweeping, "run_jobs", lambda do, jobs, *_, **__: ((n, do(j)) for n, j in enumerate(jobs)))
    first = run_sweep(swept, ONE_WORKER, False, silent)
    monkeypatch.setattr(sweeping, "do_trial", None)
    assert [sweeping.do_unfinished((trial, None)) for trial in swept] == first
    with pytest.raises(TypeError):
        sweeping.do_unfinished((swept[0], first[0]))


def test_jobs_are_listed_with_their_times_and_none_is_run(place, here):
    options = ("--kinds", "forward,named", "--counts", "2,4", "--seeds", "0", "--out", "run")
    listed = done("ablate", place.paired, *options, "--dry-run")
    assert "4 jobs, 0 done; they take roughly" in listed.out and "named, 2 episodes, seed 0" in listed.out
    assert not list(Path().iterdir())
    done("ablate", place.paired, *options[:1], "forward", *options[2:], *BRIEF)
    content = done("ablate", place.paired, *options, *BRIEF, "--dry-run", "--workers", "2", "--json").json
    assert [job["done"] for job in content["jobs"]] == [True, False, True, False]
    assert content["workers"] == 2
    waiting = [job["seconds"] for job in content["jobs"] if not job["done"]]
    assert content["seconds_left"] == pytest.approx(max(sum(waiting) / 2, *waiting), abs=0.1)
    assert len(answers(Path("run"))) == 2


@pytest.mark.slow
def test_two_processes_share_a_sweep_in_a_folder(place, here):
    """Also a trial whose process is killed is done by the other."""
    options = ["--kinds", "forward", "--counts", "2,3,4", "--seeds", "0,1", *BRIEF]
    command = [sys.executable, "-m", "nas_data", "ablate", str(place.paired), *options]
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}

    def begin(*more: str) -> subprocess.Popen:
        return subprocess.Popen([*command, "--out", "run", *more], env=environment, stderr=subprocess.PIPE, text=True)

    killed = begin("--executor", "folder")
    until(lambda: Path("run/.unfinished").is_dir() and list(Path("run/.unfinished").iterdir()))
    sharing = [begin("--join") for _ in range(2)]
    killed.send_signal(signal.SIGKILL)
    killed.wait()
    said = [process.communicate()[1] for process in sharing]
    assert [process.returncode for process in sharing] == [0, 0], said
    done("ablate", place.paired, *options, "--out", "alone")
    assert len(answers(Path("run"))) == 6
    assert answers(Path("run")) == answers(Path("alone"))


def test_the_trainings_follow_a_preset_and_what_is_given_beside_it(place, here):
    brief = ("--kinds", "forward", "--counts", "2", "--seeds", "0", "--updates", "2", "--hidden", "8")
    sweep = done("ablate", place.paired, *brief, "--preset", "few", "--json").json["sweep"]
    wanted = {"preset": "few", "layers": 1, "horizon": 30, "weight_decay": 1.0, "updates": 2, "hidden": 8}
    assert {name: sweep[f"option {name}"] for name in wanted} == wanted


def test_a_preset_with_stiction_serves_both_kinds(place, here):
    brief = ("--counts", "2", "--seeds", "0", "--updates", "2", "--hidden", "8", "--preset", "stiction")
    content = done("ablate", place.paired, "--kinds", "delta", "forward", *brief, "--json").json
    assert set(content["kinds"]) == {"delta", "forward"}


def test_what_judges_must_not_train(place, here):
    answer = nas("ablate", place.paired, "--test", place.raw)
    assert answer.code == 2 and "test episodes must not be training episodes" in answer.err
    other = write_version(recorded_on(pendulum(*GAP), wander((50,) * 2, seed=9)), "other", SIMULATED)
    options = ("--test", other, "--kinds", "delta", "--seeds", "0", "--minutes", "0.1,all", *BRIEF)
    content = done("ablate", place.paired, *options, "--json").json
    assert [cell["minutes"] for cell in content["kinds"]["delta"]] == [0.1, pytest.approx(0.16)]
    (record, *_) = answers(Path("runs/ablation")).values()
    assert len(record["open_loop"]["hold"]["per_episode"]) == 2


# with effects


@pytest.mark.slow
def test_effects_are_named_from_the_subset_and_beat_the_source(here):
    Path("arm.xml").write_text(ARM)
    arm = recorded(Path("arm.xml"), Path("data"), "--effect", "viscous_friction:joint=shoulder,coefficient=0.05")
    done("ablate", arm, "--model", "arm.xml", "--kinds", "named", "--counts", "3,6", "--seeds", "0", "--out", "run")
    for record in answers(Path("run")).values():
        assert record["question"]["config"]["options"] is None
        assert ("viscous_friction", "shoulder") in {(e["effect"], e["joint"]) for e in record["effects"]}
        errors = record["open_loop"]
        assert errors["named"]["overall"] < 0.3 * errors["source"]["overall"]


@pytest.mark.parametrize(
    ("sample", "kinds", "words"),
    [
        (False, "named,named_delta", ("named", "named + φ", "source", "hold", "command", "Smallest amount of data")),
        pytest.param(True, "delta,forward,named,named_delta", ("source + φ", "ψ"), marks=pytest.mark.slow),
    ],
    ids=["pendulum", "sample"],
)
def test_a_sweep_with_names_ends_in_table_figure_and_sentence(place, here, sample, kinds, words):
    shutil.copytree(SAMPLE if sample else place.paired, "arm")
    texts, retuned = ["speed_limit:joint=m2,speed=5", "speed_limit:joint=m3,speed=5"], "m2.damping"
    if not sample:
        texts = ["speed_limit:joint=pendulum,speed=5", "viscous_friction:joint=pendulum,coefficient=0.02"]
        retuned = "pendulum.damping"
    Path("gap").mkdir()
    write_effects(Path("gap"), [parse(text) for text in texts], {retuned: 1.1})
    answer = done(
        "ablate", "arm", "--kinds", kinds, "--effects", "gap", "--counts", "2,4", "--seeds", "0", "--out", "run",
        "--quick", *BRIEF,
    )  # fmt: skip
    for word in words:
        assert word in answer.out
    count = 2 * len(kinds.split(","))
    assert f"{count} of {count}" in answer.err and "left" in answer.err
    content = json.loads(Path("run/ablation.json").read_text())
    assert list(content["kinds"]) == kinds.split(",")
    assert content["seeds"] == [0] and content["sweep"]["option hidden"] == 8
    named = [cell["open_loop"]["values"] for cell in content["kinds"]["named"]]
    assert named[0] == named[1], "given effects do not depend on the subset"
    assert named[0] != content["baselines"]["source"]["open_loop"]["values"]
    assert {path.name for path in Path("run").iterdir()} >= {"ablation.json", "ablation.md", "ablation.png", "trials"}
    (record,) = [r for r in answers(Path("run")).values() if asked(r) == ("named", 2, 0)]
    assert record["retuned"] == {retuned: 1.1} and len(record["effects"]) == 2


def asked(record: dict) -> tuple[str, float, int]:
    """Return kind, amount and seed."""
    config = record["question"]["config"]
    return config["kind"], config["amount"], config["seed"]
