"""`nas benchmark augmented`: all sides live the same episodes, so that only how they are stepped is compared."""

import json

import numpy as np
import pytest

from nas_data.benchmarks.augmented import GOALS, GymReacher, NaiveReacher, make_dummy_vec_env, make_random_phi
from nas_data.cli import main
from nas_data.envs.ergo_reacher import TASK
from nas_data.envs.loop.arm_vec_env import ArmVecEnv
from nas_data.models.augmented import AugmentedStepper

pytestmark = pytest.mark.usefixtures("one_thread")

ARMS = 3


def phi(correction: float):
    model = make_random_phi()
    model.get_buffer("output_std").fill_(correction)
    return model


def sides(simulator, model=None):
    """Return our environment and stable-baselines3's, with or without φ."""
    if model is None:
        ours, make = simulator.stepper(ARMS), lambda: GymReacher(simulator.model)
    else:
        ours, make = AugmentedStepper(simulator.stepper(ARMS), model), lambda: NaiveReacher(simulator.model, model)
    return ArmVecEnv(TASK, ours), make_dummy_vec_env(make, ARMS)


@pytest.mark.parametrize("correction", [None, 1e-3], ids=["plain", "augmented"])
def test_batched_environments_live_the_episodes_of_single_ones(correction):
    ours, other = sides(TASK.simulator(), None if correction is None else phi(correction))
    rng = np.random.default_rng(0)
    for environment in (ours, other):
        environment.seed(7)
    np.testing.assert_allclose(ours.reset(), other.reset(), rtol=0, atol=1e-6)
    ended = 0
    for _ in range(TASK.horizon + 20):
        actions = rng.uniform(-1, 1, (ARMS, 4)).astype(np.float32)
        (seen, reward, done, infos), (expected, wanted, over, others) = (e.step(actions) for e in (ours, other))
        np.testing.assert_allclose(seen, expected, rtol=0, atol=1e-6)
        np.testing.assert_allclose(reward, wanted, rtol=0, atol=1e-6)
        assert np.array_equal(done, over)
        for row in np.flatnonzero(done):
            ended += 1
            assert infos[row]["TimeLimit.truncated"] == others[row]["TimeLimit.truncated"]
            assert infos[row]["episode"]["l"] == others[row]["episode"]["l"]
            np.testing.assert_allclose(
                infos[row]["terminal_observation"], others[row]["terminal_observation"], rtol=0, atol=1e-6
            )
    assert ended >= ARMS


def test_a_correction_moves_the_arm_and_the_one_that_is_timed_hardly_does():
    last = {}
    for correction in (0.0, 1e-5, 1e-3):
        environment, _ = sides(TASK.simulator(), phi(correction))
        environment.seed(7)
        environment.reset()
        for _ in range(50):
            last[correction] = environment.step(np.full((ARMS, 4), 0.4, np.float32))[0]
    assert np.abs(last[1e-3] - last[0.0]).max() > 1e-3
    assert 0 < np.abs(last[1e-5] - last[0.0]).max() < 1e-3


def test_the_benchmark_answers_with_its_ratios_of_processor_time(capsys):
    assert main(["benchmark", "augmented", "--frames", "64", "--rounds", "1", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert set(answer["ratios"]) == set(answer["wanted"]) == {f"augmented_vs_{name}" for name in GOALS}
    cpu = {name: times["cpu"] for name, times in answer["microseconds_per_frame"].items()}
    naive = [slow / fast for slow, fast in zip(cpu["naive_16"], cpu["augmented_16"], strict=True)]
    assert answer["rounds"]["augmented_vs_naive_16"] == pytest.approx(naive)
    large = [slow / fast for slow, fast in zip(cpu["plain_64"], cpu["augmented_64"], strict=True)]
    assert answer["rounds"]["augmented_vs_plain_64"] == pytest.approx(large)
    assert min(naive) > 1.5


def test_a_rollout_too_short_for_every_environment_to_take_a_step_is_refused(capsys):
    assert main(["benchmark", "augmented", "--frames", "63"]) == 2
    assert "--frames is 63" in capsys.readouterr().err
