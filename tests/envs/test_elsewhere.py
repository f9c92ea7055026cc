"""Environments in other hands: made by name in any process, pickled, and given actions that are none."""

import copy
import pickle
import subprocess
import sys

import cloudpickle
import gymnasium
import numpy as np
import pytest

from nas_data import registry
from nas_data.environment_ids import make_environment_id
from nas_data.envs.base import find_task
from nas_data.envs.loop.arm_vec_env import ArmVecEnv
from nas_data.errors import OptionError

NAME = "nas_data:nas/ErgoReacher-v0"
TASKS = registry.list_names("envs")
BAD = {"nan": np.nan, "inf": np.inf, "-inf": -np.inf}


@pytest.mark.parametrize(
    "before",
    [
        "",
        "import gymnasium, nas_data.envs",
        pytest.param("import nas_data", marks=pytest.mark.slow),
        pytest.param("import nas_data, gymnasium", marks=pytest.mark.slow),
    ],
)
def test_a_fresh_process_finds_the_name_whatever_it_imported_before(before):
    code = f"{before}\nimport gymnasium\n"
    code += f"print(gymnasium.make({NAME!r}).spec.id)" if not before else f"print(gymnasium.spec({NAME[9:]!r}).id)"
    run = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert run.stdout.strip() == "nas/ErgoReacher-v0"


@pytest.mark.parametrize("context", ["spawn", pytest.param("forkserver", marks=pytest.mark.slow)])
def test_worker_processes_make_environments_by_name(context):
    alone = gymnasium.make(NAME, dynamics="backlash")
    action = np.full(4, 0.5, np.float32)
    options = {"vectorization_mode": "async", "vector_kwargs": {"context": context, "shared_memory": False}}
    several = gymnasium.make_vec(NAME, num_envs=1, dynamics="backlash", **options)
    try:
        np.testing.assert_array_equal(several.reset(seed=3)[0][0], alone.reset(seed=3)[0])
        assert several.step(action[None])[1][0] == alone.step(action)[1]
    finally:
        several.close()


@pytest.mark.parametrize("task", TASKS)
@pytest.mark.parametrize("again", [lambda env: pickle.loads(pickle.dumps(env)), copy.deepcopy])
def test_a_pickled_environment_lives_through_the_same_episodes(task, again):
    env = gymnasium.make(make_environment_id(task), dynamics=list(find_task(task).dynamics)[-1])
    env.reset(seed=1)
    env.step(env.action_space.sample())
    other = again(env)
    np.testing.assert_array_equal(env.reset(seed=2)[0], other.reset(seed=2)[0])
    action = env.action_space.sample()
    assert env.step(action)[1] == other.step(action)[1]


def test_cloudpickle_takes_an_environment_with_its_dynamics():
    env = gymnasium.make(NAME, dynamics="backlash")
    other = pickle.loads(cloudpickle.dumps(env))
    assert other.unwrapped.arena.stepper.simulator.describe() == env.unwrapped.arena.stepper.simulator.describe()


@pytest.mark.parametrize("task", TASKS)
@pytest.mark.parametrize("bad", BAD)
def test_an_action_that_is_not_finite_is_refused_and_moves_nothing(task, bad):
    env = gymnasium.make(make_environment_id(task)).unwrapped
    env.reset(seed=0)
    before = env.arena.stepper.states
    action = np.zeros(env.action_space.shape)
    action[-1] = BAD[bad]
    with pytest.raises(
        ValueError, match=f"Component {len(action) - 1} of the action is {bad}; finite numbers are needed"
    ):
        env.step(action)
    np.testing.assert_array_equal(env.arena.stepper.states, before)
    assert env.arena.elapsed[0] == 0
    env.step(np.zeros(env.action_space.shape))  # the episode goes on


def test_a_batch_refuses_an_action_that_is_not_finite():
    task = find_task("ergo_reacher")
    arms = ArmVecEnv(task, task.simulator().stepper(2))
    arms.reset()
    with pytest.raises(OptionError, match="Component 1 of the action is nan"):
        arms.step(np.array([[0, 0, 0, 0], [0, np.nan, 0, 0]]))


def test_an_action_of_another_shape_is_refused():
    env = gymnasium.make(NAME).unwrapped
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"The actions have the shape \(1,\); \(4,\) is needed"):
        env.step(np.zeros(1))
