"""Domain randomisation: every episode another model, the same seed the same bits, the source among what is drawn."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nas_data import registry
from nas_data.envs.loop.arm_vec_env import ArmVecEnv
from nas_data.envs.loop.dynamics_spec import DynamicsSpec
from nas_data.envs.loop.randomised import RandomisedStepper, make_delay_line
from nas_data.envs.loop.ranges import NOMINAL, RANGES
from nas_data.envs.loop.task_batch import TaskBatch
from nas_data.errors import OptionError
from nas_data.policies.policy import Hyperparameters, load_policy
from nas_data.policies.ppo import PolicyTraining, train
from nas_data.simulators.base import RandomizedStepper
from nas_data.simulators.mujoco import MujocoSimulator

TASKS = registry.list_names("envs")
STEPS = 30


def randomised(task, size=3):
    return DynamicsSpec(task, randomised=True).stepper(size)


def nominal(task, size=3):
    """Simulations that are drawn anew, always the source itself."""
    plant = DynamicsSpec(task).task
    robot, _ = plant.body()
    return RandomisedStepper(
        MujocoSimulator(robot, plant.period, plant.joints, (make_delay_line(),)).stepper(size), NOMINAL
    )


def lived(task, stepper, seed=0, steps=STEPS, starts=1):
    """States of an environment under random actions, shape (T, B, 2n)."""
    arena = TaskBatch(DynamicsSpec(task).task, stepper)
    rngs = [np.random.default_rng(seed + row) for row in range(arena.size)]
    for _ in range(starts):
        arena.start(rngs)
    width = arena.task.action_space.shape[0]
    rows = [np.random.default_rng(100 + row).uniform(-1, 1, (steps, width)) for row in range(arena.size)]
    actions = np.stack(rows, axis=1)
    states = []
    for step in range(steps):
        arena.step(actions[step])
        states.append(stepper.states)
    return np.stack(states)


@pytest.mark.parametrize("task", TASKS)
def test_with_nothing_to_draw_it_is_the_source_to_the_last_bit(task):
    np.testing.assert_array_equal(lived(task, nominal(task)), lived(task, DynamicsSpec(task).stepper(3)))


@pytest.mark.parametrize("task", TASKS)
def test_the_same_seed_gives_the_same_bits_and_another_seed_others(task):
    first = lived(task, randomised(task))
    np.testing.assert_array_equal(first, lived(task, randomised(task)))
    assert np.abs(first - lived(task, randomised(task), seed=5)).max() > 1e-3


@pytest.mark.parametrize("task", TASKS)
def test_rows_and_episodes_have_models_of_their_own(task):
    stepper = randomised(task)
    rngs = [np.random.default_rng(row) for row in range(3)]
    stepper.redraw(rngs)
    first = {name: np.array(values) for name, values in stepper.fields.items()}
    assert len({row.tobytes() for row in first["body_mass"]}) == 3
    stepper.redraw(rngs[1:2], np.array([1]))
    for name, values in stepper.fields.items():
        np.testing.assert_array_equal(values[[0, 2]], first[name][[0, 2]])
    assert not np.array_equal(stepper.fields["body_mass"][1], first["body_mass"][1])
    assert not np.array_equal(stepper.fields["actuator_gainprm"][1], first["actuator_gainprm"][1])
    assert not np.array_equal(stepper.fields["actuator_delay"][1], first["actuator_delay"][1])


def test_episodes_of_a_row_depend_neither_on_the_batch_nor_on_other_rows():
    np.testing.assert_array_equal(
        lived("pusher", randomised("pusher", 3), starts=2)[:, :2], lived("pusher", randomised("pusher", 2), starts=2)
    )


def test_starts_and_goals_are_those_of_the_source_with_the_same_seed():
    goals = []
    for stepper in (randomised("pusher"), DynamicsSpec("pusher").stepper(3)):
        arena = TaskBatch(DynamicsSpec("pusher").task, stepper)
        rngs = [np.random.default_rng(row) for row in range(3)]
        arena.start(rngs)
        arena.start(rngs)
        goals.append(arena.goals.copy())
    np.testing.assert_array_equal(*goals)


def test_what_the_engine_derives_from_the_masses_follows_them():
    stepper = randomised("ergo_reacher", 2)
    stepper.redraw([np.random.default_rng(0), np.random.default_rng(1)])
    for row in range(2):
        subtree = stepper.stepper.batch.expanded("body_subtreemass")[row, 0]
        assert subtree == pytest.approx(stepper.fields["body_mass"][row].sum())


@pytest.mark.parametrize("name", [field.name for field in dataclasses.fields(RANGES)])
def test_the_ranges_contain_the_source(name):
    low, high = getattr(RANGES, name)
    (own, _) = getattr(NOMINAL, name)
    assert low <= own <= high
    assert low < high


@given(seed=st.integers(0, 2**32))
def test_every_draw_lies_within_its_range(seed):
    model = MODELS["ergo_reacher"]
    drawn = RANGES.draw(np.random.default_rng(seed), model, 6)
    for field in dataclasses.fields(RANGES):
        low, high = getattr(RANGES, field.name)
        values = np.atleast_1d(getattr(drawn, field.name))
        assert (low * (1 - 1e-12) <= values).all()
        assert (values <= high * (1 + 1e-12)).all()


MODELS = {"ergo_reacher": DynamicsSpec("ergo_reacher").simulator().model}


def test_a_plant_says_that_it_is_randomised_and_how():
    described = DynamicsSpec("pusher", randomised=True).describe()
    assert described["randomised"]["mass"] == [0.5, 1.5]
    assert "randomised" not in DynamicsSpec("pusher").describe()


def test_only_the_plain_physics_is_randomised():
    with pytest.raises(OptionError, match="plain MuJoCo physics"):
        DynamicsSpec("ergo_shield", engine="bullet", randomised=True).stepper(1)


def test_only_a_randomised_batch_is_drawn_anew():
    assert isinstance(randomised("pusher", 1), RandomizedStepper)
    assert not isinstance(DynamicsSpec("pusher").stepper(1), RandomizedStepper)


def test_a_finished_episode_is_followed_by_one_on_another_model():
    stepper = randomised("ergo_reacher", 1)
    env = ArmVecEnv(DynamicsSpec("ergo_reacher").task, stepper)
    env.seed(0)
    env.reset()
    masses = {stepper.fields["body_mass"][0].tobytes()}
    for _ in range(101):
        env.step(np.zeros((1, 4)))
        masses.add(stepper.fields["body_mass"][0].tobytes())
    assert len(masses) == 2


def test_a_training_goes_on_to_the_same_bits_after_an_interruption(tmp_path):
    small = Hyperparameters(arms=4, rollout=256, minibatches=4, epochs=1)
    plant = DynamicsSpec("pusher", randomised=True)
    for name, lengths in (("whole", (6,)), ("stopped", (3, 6))):
        for rollouts in lengths:
            train(PolicyTraining(plant, 0, rollouts * 256, small), tmp_path / name, lambda _: None)
    one, other = (load_policy(tmp_path / name).tensors for name in ("whole", "stopped"))
    for name in one:
        np.testing.assert_array_equal(one[name], other[name], err_msg=name)
