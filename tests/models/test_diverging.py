"""Simulations that leave all bounds: their episodes end badly, and the others, like other jobs, go on."""

import json
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from support.first_order_arm import FirstOrderArm
from support.jobs import half, named

from nas_data.envs.ergo_reacher import TASK
from nas_data.envs.loop.arm_env import ArmEnv
from nas_data.envs.loop.arm_vec_env import ArmVecEnv
from nas_data.envs.loop.dynamics_spec import DynamicsSpec
from nas_data.envs.loop.task_batch import TaskBatch
from nas_data.errors import JobsFailed, SimulationDiverged
from nas_data.policies import compare as comparing
from nas_data.policies import evaluate
from nas_data.policies.compare import Study, compare
from nas_data.policies.policy import Hyperparameters, read_progress
from nas_data.policies.ppo import PolicyTraining, train
from nas_data.runs.parallel import Workers, run_jobs

BAD = 1.2  # [rad] commands of the first joint beyond this are not borne


class Fragile(FirstOrderArm):
    """An arm whose simulation is lost where one joint is commanded too far, until it is reset."""

    def step(self, commands):
        super().step(commands)
        self._states[commands[:, 1] > BAD] = np.nan
        return self.states


def actions(size, bad=()):
    chosen = np.zeros((size, 4), dtype=np.float32)
    chosen[list(bad), 0] = 1.0
    return chosen


def test_an_episode_that_leaves_all_bounds_ends_and_the_others_go_on():
    arms = ArmVecEnv(TASK, Fragile(3))
    arms.seed(0)
    before = arms.reset()
    for _ in range(4):
        before, *_ = arms.step(actions(3))
    observations, rewards, done, infos = arms.step(actions(3, bad=[1]))
    assert done.tolist() == [False, True, False]
    assert np.isfinite(observations).all() and np.isfinite(rewards).all()
    np.testing.assert_array_equal(infos[1]["terminal_observation"], before[1])
    assert not infos[1]["TimeLimit.truncated"] and not infos[1]["is_success"]
    (episode,) = arms.take_episodes()
    assert episode.diverged and episode.length == 5
    _, _, done, _ = arms.step(actions(3))
    assert not done.any()


@pytest.mark.parametrize("after", [1, 5, 60, TASK.horizon - 1])
def test_leaving_all_bounds_is_worse_than_any_episode_that_goes_on(after):
    arena = TaskBatch(TASK, Fragile(6))
    arena.start([np.random.default_rng(row) for row in range(6)])
    totals, running = np.zeros(6), np.ones(6, dtype=bool)
    rng = np.random.default_rng(0)
    for step in range(TASK.horizon):
        chosen = rng.uniform(-1, 0.5, (6, 4))
        chosen[0] = actions(1, bad=[0])[0] if step == after else chosen[0]
        verdict, truncated = arena.step(chosen)
        totals += running * verdict.reward
        running &= ~(verdict.terminated | truncated)
        if arena.lost.any():
            arena.start([np.random.default_rng(0)], np.array([0]))
    assert totals[0] < totals[1:].min() or after > 50  # what was earned before stays earned
    assert np.isfinite(totals).all()


def test_the_steps_that_were_due_count_with_the_least_reward_seen_by_anyone():
    arena = TaskBatch(TASK, Fragile(2))
    arena.start([np.random.default_rng(row) for row in range(2)])
    least = min(arena.step(actions(2))[0].reward.min() for _ in range(10))
    verdict, truncated = arena.step(actions(2, bad=[0]))
    least = min(least, verdict.reward[1])
    assert verdict.reward[0] == pytest.approx((TASK.horizon - 10) * least)
    assert verdict.terminated.tolist() == [True, False] and not truncated[0]


class Paid(type(TASK)):
    """A task that pays for every step."""

    def judge(self, stepper, goals, chosen):
        verdict = super().judge(stepper, goals, chosen)
        return type(verdict)(np.ones(len(goals)), np.zeros(len(goals), dtype=bool), verdict.success)


def test_where_every_step_is_paid_for_nothing_more_is_paid():
    task = Paid(**{name: getattr(TASK, name) for name in TASK.__dataclass_fields__})
    arena = TaskBatch(task, Fragile(2))
    arena.start([np.random.default_rng(row) for row in range(2)])
    arena.step(actions(2))
    assert arena.step(actions(2, bad=[0]))[0].reward.tolist() == [0.0, 1.0]


def test_where_nothing_but_divergence_is_known_it_is_an_error():
    arena = TaskBatch(TASK, Fragile(2))
    arena.start([np.random.default_rng(row) for row in range(2)])
    with pytest.raises(SimulationDiverged, match="in its first step"):
        arena.step(actions(2, bad=[0, 1]))


def test_a_single_arm_ends_its_episode_too():
    env = ArmEnv("ErgoReacher", stepper=Fragile(1))
    env.reset(seed=0)
    before, *_ = env.step(actions(1)[0])
    after, reward, terminated, truncated, info = env.step(actions(1, bad=[0])[0])
    assert terminated and not truncated and info["diverged"]
    np.testing.assert_array_equal(before, after)
    assert reward < -1


def test_a_judged_episode_that_diverges_is_counted_and_the_others_are_what_they_were():
    whole = evaluate.roll_out(TASK, Fragile(5), lambda _: lambda __: actions(5))
    broken = evaluate.roll_out(TASK, Fragile(5), lambda _: lambda __: actions(5, bad=[2]) if len(taken) else note())
    assert whole.diverged.sum() == 0
    assert broken.diverged.tolist() == [False, False, True, False, False]
    others = [0, 1, 3, 4]
    np.testing.assert_array_equal(broken.returns[others], whole.returns[others])
    assert broken.returns[2] < whole.returns.min()
    assert broken.describe()["diverged"] == 1


taken: list[int] = []


def note():
    taken.append(1)
    return actions(5)


def test_training_goes_on_counts_what_diverged_and_learns_to_avoid_it(tmp_path):
    told = []
    keen = Hyperparameters(arms=8, rollout=1024, minibatches=8, epochs=4, learning_rate=2e-3)
    train(PolicyTraining(DynamicsSpec("ErgoReacher"), 0, 12 * 1024, keen), tmp_path, told.append, Fragile(keen.arms))
    diverged = read_progress(tmp_path)["diverged"]
    assert diverged[-1] < diverged[0] / 3
    assert any("diverged" in line for line in told)


# one job at a time here, or two in threads, which are begun and judged as processes are
SIDE_BY_SIDE = pytest.mark.parametrize(("workers", "pool"), [(1, None), (2, ThreadPoolExecutor)])


@SIDE_BY_SIDE
def test_other_jobs_go_on_where_some_fail_and_the_failures_are_told_at_the_end(workers, pool):
    done = []
    with pytest.raises(JobsFailed, match=r"2 of 5 jobs failed.*number 1 left.*number 3 left"):
        for number, result in run_jobs(half, range(5), Workers(workers, pool)):
            done.append((number, result))
    assert sorted(done) == [(0, 0), (2, 2), (4, 4)]


@SIDE_BY_SIDE
def test_jobs_that_build_on_failed_ones_are_left_out_and_that_is_said(workers, pool):
    done = []
    with pytest.raises(JobsFailed, match=r"2 of 6 jobs failed; 2 that depend on them were skipped; all others are"):
        for number, _ in run_jobs(half, range(6), Workers(workers, pool), {2: [1], 4: [0], 5: [2, 0]}):
            done.append(number)
    assert sorted(done) == [0, 4]
    assert done.index(0) < done.index(4)


@SIDE_BY_SIDE
def test_a_single_failure_stays_what_it_is(workers, pool):
    with pytest.raises(SimulationDiverged, match="number 1"):
        list(run_jobs(half, range(3), Workers(workers, pool)))


def test_a_name_that_a_worker_process_does_not_know_is_told_as_here():
    with pytest.raises(JobsFailed, match=r"no number '0'; choose one of: one\. There is no number '1'"):
        list(run_jobs(named, range(2), Workers(2)))


def test_a_study_does_its_other_runs_where_one_cannot_be_done(tmp_path, monkeypatch):
    original = comparing.train

    def failing(training, folder, report=None):
        if training.plant.dynamics == "source" and training.seed == 0:
            raise SimulationDiverged("it left all bounds.")
        return original(training, folder, report)

    monkeypatch.setattr(comparing, "train", failing)
    tiny = Hyperparameters(arms=2, rollout=32, minibatches=2, epochs=1)
    target = DynamicsSpec("Pusher", "backlash")
    study = Study(target, {"source": DynamicsSpec("Pusher"), "expert": target}, (0, 1), 32, 2, tiny)
    with pytest.raises(SimulationDiverged, match="source, seed 0: it left all bounds"):
        compare(study, tmp_path, report=lambda _: None)
    assert sorted(str(path.parent.relative_to(tmp_path)) for path in tmp_path.rglob("result.json")) == [
        "expert/seed0",
        "expert/seed1",
        "source/seed1",
    ]
    monkeypatch.setattr(comparing, "train", original)
    found = compare(study, tmp_path, report=lambda _: None)
    assert found.describe()["methods"]["source"]["diverged"] == {"learning": [0, 0], "judging": [0, 0]}
    record = json.loads((tmp_path / "source/seed0/result.json").read_text())
    assert record["judging"]["cpu_seconds"] > 0
    assert found.describe_diverged() == []
