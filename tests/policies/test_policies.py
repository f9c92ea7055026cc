"""Policies: same seed, same bits, also when interrupted; saved is loaded; PPO learns; comparisons are fair."""

import json
import shutil
import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from support.first_order_arm import FirstOrderArm

from nas_data import cli
from nas_data.commands.policy_train import PolicyTrain, suggest_evaluation
from nas_data.envs.base import find_task
from nas_data.envs.ergo_reacher import TASK
from nas_data.envs.loop.dynamics_spec import DynamicsSpec
from nas_data.errors import CheckpointError, OutputExists, SimulationDiverged, WorkerLost
from nas_data.policies import evaluate, ppo
from nas_data.policies import folder as files
from nas_data.policies.compare import Study, compare
from nas_data.policies.folder import STATE, save_policy
from nas_data.policies.intervals import compute_share
from nas_data.policies.policy import (
    CONFIG,
    WEIGHTS,
    Hyperparameters,
    find_policies,
    load_policy,
    read_progress,
    read_result,
)
from nas_data.policies.ppo import Learner, PolicyTraining, train
from nas_data.runs.parallel import Workers, run_jobs

SMALL = Hyperparameters(arms=4, rollout=512, minibatches=4, epochs=2)
BRIEF = replace(SMALL, rollout=128, minibatches=2, epochs=1)
REACHER = DynamicsSpec("ErgoReacher")


def training(frames, seed=0, hyperparameters=SMALL):
    return PolicyTraining(REACHER, seed, frames, hyperparameters)


def learn(folder, frames, seed=0, hyperparameters=SMALL, report=None):
    task = training(frames, seed, hyperparameters)
    return train(task, folder, report or (lambda _: None), FirstOrderArm(hyperparameters.arms))


def weights(folder):
    return load_policy(folder).tensors


def assert_same_bits(one, other):
    assert one.keys() == other.keys()
    for name in one:
        np.testing.assert_array_equal(one[name], other[name], err_msg=name)


class Interrupted(Exception):
    """Stands for a power cut."""


def stop_after(rollouts):
    told = []

    def report(message):
        told.append(message)
        if len(told) == rollouts:
            raise Interrupted

    return report


def test_same_seed_same_bits_for_10000_frames_and_another_seed_others(tmp_path):
    full = Hyperparameters(epochs=1)
    for name, seed in (("a", 0), ("b", 0), ("c", 1)):
        learn(tmp_path / name, 10_000, seed, full)
    assert_same_bits(weights(tmp_path / "a"), weights(tmp_path / "b"))
    assert not np.array_equal(
        weights(tmp_path / "a")["action_net.weight"], weights(tmp_path / "c")["action_net.weight"]
    )


def test_a_rollout_in_which_no_episode_ended_has_no_score(tmp_path):
    told = []
    short = Hyperparameters(arms=4, rollout=16, minibatches=2, epochs=1)  # four steps of an episode
    learn(tmp_path / "a", 16, hyperparameters=short, report=told.append)
    assert "no episode finished yet" in told[-1]
    assert "nan" not in told[-1]


@pytest.mark.parametrize(
    "stopped",
    [*(pytest.param(rollouts, marks=pytest.mark.slow) for rollouts in (3, Learner.SEGMENT)), Learner.SEGMENT + 4],
)
def test_an_interrupted_training_goes_on_to_the_same_bits(tmp_path, stopped):
    frames = (Learner.SEGMENT + 6) * BRIEF.rollout
    learn(tmp_path / "whole", frames, hyperparameters=BRIEF)
    with pytest.raises(Interrupted):
        learn(tmp_path / "stopped", frames, hyperparameters=BRIEF, report=stop_after(stopped))
    learn(tmp_path / "stopped", frames, hyperparameters=BRIEF)
    assert_same_bits(weights(tmp_path / "whole"), weights(tmp_path / "stopped"))
    whole, going_on = (read_progress(tmp_path / name) for name in ("whole", "stopped"))
    for column in set(whole) - {"seconds", "cpu_seconds"}:
        np.testing.assert_array_equal(whole[column], going_on[column])


def test_a_longer_training_equals_a_short_one_that_was_extended(tmp_path):
    short, long = (Learner.SEGMENT + 3) * BRIEF.rollout, (Learner.SEGMENT + 5) * BRIEF.rollout
    learn(tmp_path / "extended", short, hyperparameters=BRIEF)
    learn(tmp_path / "extended", long, hyperparameters=BRIEF)
    learn(tmp_path / "long", long, hyperparameters=BRIEF)
    assert_same_bits(weights(tmp_path / "extended"), weights(tmp_path / "long"))


def test_a_finished_training_is_not_done_again(tmp_path):
    learn(tmp_path / "p", 600)
    before = (tmp_path / "p" / WEIGHTS).stat().st_mtime_ns
    learn(tmp_path / "p", 1024, report=stop_after(1))  # 600 and 1024 frames are both two rollouts
    assert (tmp_path / "p" / WEIGHTS).stat().st_mtime_ns == before


def test_a_folder_of_another_training_is_refused_and_left_alone(tmp_path):
    learn(tmp_path / "p", 1024)
    before = weights(tmp_path / "p")
    with pytest.raises(OutputExists, match="differs in: seed"):
        learn(tmp_path / "p", 1024, seed=1)
    with pytest.raises(OutputExists, match="hyperparameters"):
        learn(tmp_path / "p", 1024, hyperparameters=replace(SMALL, clip=0.1))
    with pytest.raises(OutputExists, match="1024 frames, more than"):
        learn(tmp_path / "p", 512)
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "notes.txt").write_text("mine")
    with pytest.raises(OutputExists, match="is not a policy folder"):
        learn(tmp_path / "other", 512)
    assert_same_bits(before, weights(tmp_path / "p"))


@pytest.mark.parametrize("hidden", [(64, 64), (16,)])
def test_the_actor_and_critic_learn_what_those_of_stable_baselines3_do(monkeypatch, hidden):
    task = training(2048, seed=3, hyperparameters=replace(SMALL, hidden=hidden))
    learners = []
    for policy in (ppo.ActorCritic, "MlpPolicy"):
        monkeypatch.setattr(ppo, "ActorCritic", policy)
        learners.append(Learner(task, FirstOrderArm(SMALL.arms)))
        for _ in range(4):
            learners[-1].advance()
    ours, theirs = (one.ppo.policy for one in learners)
    assert type(ours) is not type(theirs)
    assert_same_bits(ours.state_dict(), theirs.state_dict())
    observations = torch.randn(7, *task.plant.task.observation_space.shape)
    for asked in (True, False):
        torch.manual_seed(1)
        answer = ours(observations, deterministic=asked)
        torch.manual_seed(1)
        for one, other in zip(answer, theirs(observations, deterministic=asked), strict=True):
            assert torch.equal(one, other)
    actions = torch.randn(7, *task.plant.task.action_space.shape)
    for one, other in zip(*(p.evaluate_actions(observations, actions) for p in (ours, theirs)), strict=True):
        torch.testing.assert_close(one, other)
    assert torch.equal(ours.predict_values(observations), theirs.predict_values(observations))


def test_an_entropy_with_a_weight_is_learned_from():
    deviations = []
    for weight in (0.0, 0.5):
        task = training(2048, hyperparameters=replace(SMALL, entropy_weight=weight))
        one = Learner(task, FirstOrderArm(SMALL.arms))
        deviations.append([one.advance() for _ in range(4)][-1].action_std)
    assert deviations[1] > deviations[0]


def test_networks_that_are_no_longer_finite_are_told_in_a_sentence():
    one = Learner(training(2048), FirstOrderArm(SMALL.arms))
    with torch.no_grad():
        one.ppo.policy.value_net.bias[0] = torch.nan
    with pytest.raises(SimulationDiverged, match="no longer finite after 512 frames"):
        one.advance()


@pytest.mark.parametrize("hidden", [(64, 64), (16,), (8, 16, 24)])
def test_a_loaded_policy_acts_like_the_trained_network(tmp_path, hidden):
    task = training(2048, hyperparameters=replace(SMALL, hidden=hidden))
    learner = Learner(task, FirstOrderArm(SMALL.arms))
    for _ in range(4):
        learner.advance()
    save_policy(learner.ppo, learner.normalised, learner.progress, task.identity(), tmp_path)
    rng = np.random.default_rng(0)
    observations = rng.uniform(-1.5, 1.5, (500, 10)).astype(np.float32)
    expected, _ = learner.ppo.predict(learner.normalised.normalize_obs(observations), deterministic=True)
    np.testing.assert_allclose(load_policy(tmp_path).act(observations), expected, atol=2e-6)


def test_every_file_of_a_policy_is_plain_data(segment):
    kinds = {path.suffix for path in segment.iterdir()}
    assert kinds == {".json", ".csv", ".safetensors"}
    config = json.loads((segment / CONFIG).read_text())
    assert config["frames"] == Learner.SEGMENT * BRIEF.rollout
    assert config["plant"]["simulator"]["name"] == "ergojr_penholder"


def test_a_short_training_on_the_analytic_arm_beats_every_baseline(tmp_path):
    torch.manual_seed(0)
    learn(tmp_path, 16_384, hyperparameters=Hyperparameters(arms=16, rollout=2048, minibatches=8, learning_rate=3e-3))
    arm = FirstOrderArm(50)
    score = evaluate.score_policy(load_policy(tmp_path), REACHER, 50, arm)
    baselines = evaluate.score_baselines(REACHER, 50, arm)
    assert score.mean_return > max(baseline.mean_return for baseline in baselines.values()) + 1.0
    assert score.success_rate > 0.5
    curve = read_progress(tmp_path)
    assert curve["mean_return"][-1] > curve["mean_return"][0]


def test_every_policy_meets_the_same_episodes_and_scores_do_not_depend_on_their_number(tmp_path):
    learn(tmp_path, 512)
    policy = load_policy(tmp_path)
    many = evaluate.score_policy(policy, REACHER, 30, FirstOrderArm(30))
    few = evaluate.score_policy(policy, REACHER, 10, FirstOrderArm(10))
    np.testing.assert_allclose(many.returns[:10], few.returns, atol=1e-6)  # BLAS sums other shapes in other orders
    again = evaluate.score_policy(policy, REACHER, 30, FirstOrderArm(30))
    np.testing.assert_array_equal(many.returns, again.returns)


def test_an_episodes_return_counts_only_until_its_end():
    class Reached(FirstOrderArm):
        def site_positions(self, name):
            return np.tile(self.goal, (self.size, 1))

    arm = Reached(1)
    arm.goal = TASK.start(np.random.default_rng(evaluate.SEED)).goal
    score = evaluate.roll_out(TASK, arm, evaluate.act_with_zeros)
    np.testing.assert_allclose(score.returns, [1.0])
    assert score.lengths.tolist() == [1] and score.successes.tolist() == [True]


def test_holding_beats_acting_at_random_nowhere_near_success():
    baselines = evaluate.score_baselines(REACHER, 40, FirstOrderArm(40))
    assert set(baselines) == {"zero action", "hold the start", "random actions"}
    for score in baselines.values():
        assert score.mean_return < -1 and score.success_rate < 0.6


@pytest.mark.parametrize("damage", ["no weights", "cut weights", "no config", "other config", "lacks a tensor"])
def test_a_damaged_policy_is_refused_with_the_files_name(tmp_path, damage):
    learn(tmp_path, 512)
    if damage == "no weights":
        (tmp_path / WEIGHTS).unlink()
    elif damage == "cut weights":
        (tmp_path / WEIGHTS).write_bytes((tmp_path / WEIGHTS).read_bytes()[:1000])
    elif damage == "no config":
        (tmp_path / CONFIG).unlink()
    elif damage == "other config":
        (tmp_path / CONFIG).write_text('{"kind": "delta"}')
    else:
        from safetensors.numpy import save_file

        save_file({"action_net.weight": np.zeros((4, 64), np.float32)}, tmp_path / WEIGHTS)
    with pytest.raises(CheckpointError, match=str(tmp_path)):
        load_policy(tmp_path)


def test_a_damaged_training_state_is_refused(tmp_path, segment):
    folder = shutil.copytree(segment, tmp_path / "damaged")
    (folder / STATE).write_bytes(b"half")
    with pytest.raises(CheckpointError, match="train again"):
        learn(folder, 2 * Learner.SEGMENT * BRIEF.rollout, hyperparameters=BRIEF)


def test_policies_are_found_alone_and_by_seed_in_the_order_of_numbers(tmp_path):
    for seed in (10, 2):
        learn(tmp_path / f"seed{seed}", 512, seed)
    assert [folder.name for folder in find_policies(tmp_path)] == ["seed2", "seed10"]
    assert find_policies(tmp_path / "seed10") == [tmp_path / "seed10"]
    with pytest.raises(CheckpointError, match="There is no folder"):
        find_policies(tmp_path / "nothing")


returns = arrays(float, st.integers(1, 8), elements=st.floats(-10, 10))


@given(returns, returns, returns)
@settings(max_examples=30, deadline=None)
def test_the_share_closed_is_zero_for_the_source_and_one_for_the_expert_and_monotone(method, source, expert):
    result = compute_share(method, source, expert)
    if np.isnan(result.value):
        assert str(result) == "undefined"
        assert result.advantage <= 1e-9 * max(1.0, np.abs(source).max(), np.abs(expert).max())
        return
    assert compute_share(source, source, expert).value == 0
    assert compute_share(expert, source, expert).value == pytest.approx(1)
    assert compute_share(method + 1, source, expert).value > result.value
    assert result.low <= result.high


def test_the_interval_shrinks_with_the_number_of_seeds_and_holds_the_truth():
    rng = np.random.default_rng(0)
    few, many = (compute_share(*(rng.normal(mean, 0.1, n) for mean in (0.8, 0.0, 1.0))) for n in (5, 100))
    assert few.low <= 0.8 <= few.high and many.low <= 0.8 <= many.high
    assert many.high - many.low < few.high - few.low


def test_a_comparison_does_each_run_once_and_goes_on(tmp_path, monkeypatch):
    study = Study(
        target=DynamicsSpec("ErgoReacher", "backlash"),
        methods={"source": REACHER, "expert": DynamicsSpec("ErgoReacher", "backlash")},
        seeds=(0, 1),
        frames=512,
        episodes=5,
        hyperparameters=SMALL,
    )
    told = []
    first = compare(study, tmp_path, report=told.append)
    assert len(told) == 4 and "4 of 4" in told[-1]
    assert set(first.describe()["methods"]) == {"source", "expert"}
    assert "expert" in first.table()
    removed = tmp_path / "expert" / "seed1" / "result.json"
    removed.unlink()
    counted = []
    monkeypatch.setattr("nas_data.policies.compare.score_policy", count(evaluate.score_policy, counted))
    second = compare(study, tmp_path, report=told.append)
    assert len(counted) == 1
    assert without_times(second) == without_times(first)
    assert read_result(removed.parent).score == first.results["expert", 1].score


def without_times(comparison):
    return {run: replace(result, judging=None) for run, result in comparison.results.items()}


def count(function, calls):
    def counting(*arguments):
        calls.append(arguments)
        return function(*arguments)

    return counting


def test_jobs_side_by_side_give_what_one_after_the_other_gives():
    assert (
        dict(run_jobs(abs, [-1, -2, 3], Workers(2)))
        == dict(run_jobs(abs, [-1, -2, 3], Workers(1)))
        == {0: 1, 1: 2, 2: 3}
    )
    with pytest.raises(ValueError, match="invalid literal"):
        list(run_jobs(int, ["1", "one"], Workers(2)))


def test_a_worker_that_the_system_ends_is_told_in_a_sentence():
    with pytest.raises(WorkerLost, match="run the same command again"):
        list(run_jobs(signal.raise_signal, [signal.SIGKILL] * 2, Workers(2)))


@pytest.mark.usefixtures("small_ppo")
def test_seeds_of_different_training_are_not_pooled_in_silence(tmp_path, capsys):
    said = []
    for seed, frames in enumerate((256, 512, 512)):
        train = ["policy", "train", "--frames", str(frames), "--seed", str(seed), "--out", str(tmp_path / "policy")]
        assert cli.main(train) == 0
        capsys.readouterr()
        assert cli.main(["policy", "evaluate", str(tmp_path / "policy"), "--episodes", "2"]) == 0
        said.append(capsys.readouterr().err)
    trained = "seed 0 has 256 frames, seed 1 has 512 frames"
    assert ["pools" in line for line in said] == [False, True, True]
    assert trained in said[1] and f"{trained}, seed 2 has 512 frames" in said[2]


@pytest.mark.usefixtures("small_ppo")
def test_the_commands_train_and_judge(tmp_path, capsys):
    out = tmp_path / "source"
    assert cli.main(["policy", "train", "--frames", "512", "--seed", "0", "--out", str(out)]) == 0
    assert "nas policy evaluate" in capsys.readouterr().out
    assert cli.main(["policy", "evaluate", str(out), "--episodes", "10", "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["dynamics"] == "backlash"
    assert data["groups"][0]["seeds"][0]["frames"] == 512
    assert set(data["baselines"]) == set(evaluate.BASELINES)


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["train", "--on", "target", "--dynamics", "rust"], "dynamics 'rust'"),
        (["train", "--dynamics", "rust"], "dynamics 'rust'"),
        (["train", "--env", "Walker"], "environment 'Walker'"),
        (["train", "--on", "augmented"], "needs --checkpoint"),
        (["train", "--checkpoint", "x"], "takes no --checkpoint"),
        (["train", "--on", "augmented", "--checkpoint", "nowhere"], "nowhere"),
        (["train", "--frames", "0"], "--frames is 0"),
        (["train", "--seed", "1", "1"], "different numbers"),
        (["evaluate", "nowhere"], "There is no folder nowhere"),
        (["evaluate", "nowhere", "--episodes", "0"], "--episodes is 0"),
        (["evaluate", "nowhere", "--speed", "0"], "takes no --speed"),
        (["evaluate", "nowhere", "--defender-id", "d"], "takes no --defender-id"),
    ],
)
def test_bad_input_is_one_sentence_and_writes_nothing(tmp_path, monkeypatch, capsys, words, sentence):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["policy", *words]) == 2
    error = capsys.readouterr().err
    assert sentence in error and "Traceback" not in error and error.count("\n") == 1
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("dynamics", "source"), [("paper", "paper-source"), ("backlash", "source"),
                                                  ("paper-source", "paper-source")])  # fmt: skip
def test_policies_are_trained_on_the_source_that_belongs_to_the_target(dynamics, source):
    assert find_task("ErgoReacher").find_source(dynamics) == source
    assert find_task("Pusher").find_source("backlash") == "source"
    (training,) = PolicyTrain(dynamics=dynamics)._list_trainings()
    assert training.plant.dynamics == source


@pytest.fixture(scope="module")
def segment(tmp_path_factory):
    """Return the folder of a training of one segment."""
    folder = tmp_path_factory.mktemp("segment")
    learn(folder, Learner.SEGMENT * BRIEF.rollout, hyperparameters=BRIEF)
    return folder


@pytest.mark.parametrize("left", [(STATE,), (STATE, WEIGHTS), (WEIGHTS,), (f".{STATE}.17.partial",)])
def test_a_training_killed_at_its_first_save_begins_anew(tmp_path, segment, left):
    for name in left:
        (tmp_path / name).write_bytes(b"half")
    learn(tmp_path, Learner.SEGMENT * BRIEF.rollout, hyperparameters=BRIEF)
    assert_same_bits(weights(segment), weights(tmp_path))


def test_a_training_killed_before_its_last_save_is_completed(tmp_path, monkeypatch):
    frames, save = 2 * Learner.SEGMENT * BRIEF.rollout, files.save_policy
    learn(tmp_path / "whole", frames, hyperparameters=BRIEF)

    saved = []

    def killed(*given):
        if saved:
            raise Interrupted
        saved.append(True)
        save(*given)

    monkeypatch.setattr(files, "save_policy", killed)
    with pytest.raises(Interrupted):
        learn(tmp_path / "stopped", frames, hyperparameters=BRIEF)
    monkeypatch.setattr(files, "save_policy", save)
    learn(tmp_path / "stopped", frames, hyperparameters=BRIEF)
    assert_same_bits(weights(tmp_path / "whole"), weights(tmp_path / "stopped"))


def test_a_learning_curve_of_someone_elses_is_left_alone(tmp_path):
    (tmp_path / "progress.csv").write_text("mine")
    with pytest.raises(OutputExists, match="is not a policy folder"):
        learn(tmp_path, 512)
    assert (tmp_path / "progress.csv").read_text() == "mine"


@pytest.mark.parametrize(
    ("dynamics", "known", "option"),
    [
        ("backlash", ("source", "backlash"), ""),
        ("backlash", ("source", "loose"), " --dynamics loose"),
        ("bigger-gap", ("source", "backlash", "bigger-gap"), " --dynamics bigger-gap"),
    ],
)
def test_the_evaluation_that_training_suggests_names_dynamics_of_the_environment(dynamics, known, option):
    assert suggest_evaluation(Path("runs/p"), dynamics, known) == f"nas policy evaluate runs/p{option}"
