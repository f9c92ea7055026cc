"""Environments: checkers pass on all, one arm and many agree, seeds fix everything, wrong names are explained."""

import json
import warnings
from itertools import count
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env as check_gymnasium
from hypothesis import given, settings
from hypothesis import strategies as st
from stable_baselines3.common.env_checker import check_env as check_stable_baselines
from support.env_samples import play, small_model
from support.first_order_arm import FirstOrderArm

from nas_data import registry
from nas_data.environment_ids import make_environment_id
from nas_data.envs.base import StepResult, find_task, find_task_file
from nas_data.envs.ergo_reacher import ACTIVE, CENTRE, REACHED, RING, TASK
from nas_data.envs.loop.arm_env import ArmEnv
from nas_data.envs.loop.arm_vec_env import ArmVecEnv
from nas_data.envs.loop.dynamics_spec import DynamicsSpec
from nas_data.envs.loop.task_batch import TaskBatch
from nas_data.errors import CheckpointError, JointMismatch, SimulationDiverged, UnknownName

EVERY = [(task, dynamics) for task in registry.list_names("envs") for dynamics in find_task(task).dynamics]


@pytest.mark.parametrize(("task", "dynamics"), EVERY)
def test_both_checkers_pass_on_every_registered_environment_without_a_warning(task, dynamics):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = gymnasium.make(make_environment_id(task), dynamics=dynamics).unwrapped
        check_gymnasium(env, skip_render_check=True)
        check_stable_baselines(env)


BOTH_ENDS = [(task, dynamics) for task in registry.list_names("envs") for dynamics in [*find_task(task).dynamics][:2]]


SHORT, LONG = 230, 1030  # more than two episodes of most tasks; one of the longest and the next one's start


@pytest.mark.parametrize(
    ("task", "dynamics", "steps"),
    [
        *((task, dynamics, SHORT) for task, dynamics in BOTH_ENDS),
        *(
            pytest.param(task, dynamics, LONG, marks=pytest.mark.slow)
            for task, dynamics in BOTH_ENDS
            if find_task(task).horizon > SHORT
        ),
    ],
)
def test_many_arms_live_through_the_same_episodes_as_one(task, dynamics, steps):
    many, seed = 3, 5
    batch = ArmVecEnv(find_task(task), find_task(task).simulator(dynamics).stepper(many))
    singles = [ArmEnv(task, dynamics) for _ in range(many)]
    batch.seed(seed)
    seen = batch.reset()
    for row, env in enumerate(singles):
        np.testing.assert_array_equal(seen[row], env.reset(seed=seed + row)[0])
    rng = np.random.default_rng(0)
    for _ in range(steps):
        actions = rng.uniform(-1, 1, (many, *batch.action_space.shape))
        seen, rewards, dones, infos = batch.step(actions)
        for row, env in enumerate(singles):
            observation, reward, terminated, truncated, _ = env.step(actions[row])
            assert rewards[row] == pytest.approx(reward, abs=1e-7)  # stable-baselines3 wants rewards in float32
            assert dones[row] == (terminated or truncated)
            if dones[row]:
                np.testing.assert_allclose(infos[row]["terminal_observation"], observation, atol=1e-9)
                assert infos[row]["TimeLimit.truncated"] == truncated
                observation = env.reset()[0]
            np.testing.assert_allclose(seen[row], observation, atol=1e-9)
            np.testing.assert_allclose(batch.arena.stepper.states[row], env.arena.stepper.states[0], atol=1e-9)


@given(seed=st.integers(0, 2**31), size=st.integers(1, 9), data=st.data())
@settings(max_examples=20, deadline=None)
def test_a_rows_episodes_depend_neither_on_the_number_of_rows_nor_on_the_others(seed, size, data):
    row = data.draw(st.integers(0, size - 1))
    several, alone = (ArmVecEnv(TASK, FirstOrderArm(n)) for n in (size, 1))
    several.seed(seed)
    alone.seed(seed + row)
    several.reset()
    alone.reset()
    rng = np.random.default_rng(seed)
    for _ in range(120):
        actions = rng.uniform(-1, 1, (size, 4))
        seen, rewards, *_ = several.step(actions)
        seen_alone, rewards_alone, *_ = alone.step(actions[row : row + 1])
        np.testing.assert_array_equal(seen[row], seen_alone[0])
        assert rewards[row] == rewards_alone[0]


def test_the_reward_is_minus_the_distance_and_one_more_where_the_goal_is_reached():
    arena = TaskBatch(TASK, FirstOrderArm(2))
    arena.start([np.random.default_rng(0), np.random.default_rng(1)])
    tip = arena.stepper.site_positions("tip")
    goals = np.stack([tip[0] + [0, 0.5 * REACHED, 0], tip[1] + [0, 0, 3 * REACHED]])
    verdict = TASK.judge(arena.stepper, goals, np.zeros((2, 4)))
    np.testing.assert_allclose(verdict.reward, [1 - 0.5 * REACHED, -3 * REACHED])
    assert verdict.terminated.tolist() == verdict.success.tolist() == [True, False]


def test_the_idle_joints_are_commanded_to_zero_and_the_others_to_a_right_angle_at_most():
    commands = TASK.command(np.array([[1.0, -1.0, 0.5, 0.0]]))
    np.testing.assert_allclose(commands, [[0, np.pi / 2, -np.pi / 2, 0, np.pi / 4, 0]])


@given(st.integers(0, 2**32 - 1))
def test_goals_lie_in_their_ring_ahead_and_above_and_starts_are_at_rest(seed):
    start = TASK.start(np.random.default_rng(seed))
    offset = start.goal - CENTRE
    assert RING[0] <= np.linalg.norm(offset) <= RING[1]
    assert offset[0] == 0 and (offset >= 0).all()
    assert np.abs(start.state[ACTIVE]).max() <= np.radians(18)
    assert not start.state[[0, 3, *range(6, 12)]].any()


def test_every_goal_can_be_reached_above_the_floor():
    rng = np.random.default_rng(0)
    arm = FirstOrderArm(100_000)
    poses = np.zeros((arm.size, 12))
    poses[:, ACTIVE] = rng.uniform(-np.pi / 2, np.pi / 2, (arm.size, len(ACTIVE)))
    arm.reset(poses)
    tips = arm.site_positions("tip")
    tips = tips[tips[:, 2] > 0.01]
    for _ in range(100):
        goal = TASK.start(rng).goal
        assert np.linalg.norm(tips - goal, axis=1).min() < REACHED / 4


def test_the_test_double_has_the_robots_geometry():
    robot, double = TASK.simulator().stepper(20), FirstOrderArm(20)
    poses = np.zeros((20, 12))
    poses[:, ACTIVE] = np.random.default_rng(0).uniform(-1.5, 1.5, (20, len(ACTIVE)))
    for arm in (robot, double):
        arm.reset(poses)
    np.testing.assert_allclose(robot.site_positions("tip"), double.site_positions("tip"), atol=1e-12)


def test_holding_stays_near_the_start():
    arena = TaskBatch(TASK, FirstOrderArm(4))
    arena.start([np.random.default_rng(i) for i in range(4)])
    before = arena.stepper.states
    actions = TASK.hold(arena.stepper)
    for _ in range(50):
        arena.step(actions)
    np.testing.assert_allclose(arena.stepper.states, before, atol=1e-12)


def test_backlash_and_speed_limit_really_change_the_arm():
    states = []
    for dynamics in ("source", "backlash"):
        stepper = TASK.simulator(dynamics).stepper(1)
        stepper.reset(np.zeros((1, 12)))
        for _ in range(20):
            stepper.step(TASK.command(np.array([[0.5, -0.5, 0.5, -0.5]])))
        states.append(stepper.states[0, :6])
    assert np.abs(states[0] - states[1])[ACTIVE].min() > np.radians(2)


def test_an_unknown_dynamics_lists_the_choices():
    with pytest.raises(UnknownName, match=r"dynamics 'rust'.*backlash, bigger-gap, paper, paper-source, source"):
        gymnasium.make("nas/ErgoReacher-v0", dynamics="rust")


def test_an_unknown_engine_lists_the_choices():
    with pytest.raises(UnknownName, match=r"engine 'havok'.*bullet, mujoco"):
        gymnasium.make("nas/ErgoShield-v0", engine="havok")


def test_an_unknown_environment_lists_the_choices():
    with pytest.raises(UnknownName, match=r"environment 'Reacher'.*ErgoReacher"):
        find_task("Reacher")


@pytest.mark.parametrize("name", ["nas/ErgoReacher-v0", "ErgoReacher", "ergo_reacher"])
def test_an_environment_is_found_by_each_of_its_names(name):
    assert find_task_file(name) == "ergo_reacher"


def test_a_simulation_with_other_joints_is_refused():
    with pytest.raises(JointMismatch, match=r"m1, m2.*left, right"):
        TaskBatch(TASK, FirstOrderArm(1, joints=("left", "right")))


def test_a_simulation_that_diverges_says_so():
    env = ArmEnv("ErgoReacher", stepper=FirstOrderArm(1, offset=np.inf))
    env.reset(seed=0)
    with pytest.raises(SimulationDiverged, match="not stable"):
        env.step(np.zeros(4, dtype=np.float32))


def test_a_step_before_the_first_reset_is_refused():
    with pytest.raises(gymnasium.error.ResetNeeded):
        ArmEnv("ErgoReacher", stepper=FirstOrderArm(1)).step(np.zeros(4, dtype=np.float32))


def test_a_correction_of_nothing_leaves_the_source_as_it_is(tmp_path):
    plain = gymnasium.make("nas/ErgoReacher-v0")
    augmented = gymnasium.make("nas/ErgoReacher-v0", checkpoint=small_model(tmp_path / "phi", gain=0.0))
    for env in (plain, augmented):
        env.reset(seed=3)
    np.testing.assert_allclose(play(plain), play(augmented), atol=1e-5)  # φ computes in float32


@pytest.mark.parametrize("kind", ["delta", "forward"])
def test_a_learned_environment_moves_otherwise_and_forgets_at_reset(tmp_path, kind):
    checkpoint = small_model(tmp_path / kind, kind, gain=0.01)
    env = gymnasium.make("nas/ErgoReacher-v0", checkpoint=checkpoint)
    env.reset(seed=3)
    first = play(env)
    env.reset(seed=3)
    np.testing.assert_array_equal(first, play(env))
    plain = gymnasium.make("nas/ErgoReacher-v0")
    plain.reset(seed=3)
    assert np.abs(first - play(plain)).max() > 1e-3


def test_the_reward_of_a_learned_environment_comes_from_the_corrected_state(tmp_path):
    env = gymnasium.make("nas/ErgoReacher-v0", checkpoint=small_model(tmp_path / "phi", gain=0.01)).unwrapped
    env.reset(seed=3)
    _, reward, *_ = env.step(np.ones(4, dtype=np.float32))
    fresh = TASK.simulator().stepper(1)
    fresh.reset(env.arena.stepper.states)
    distance = np.linalg.norm(fresh.site_positions("tip")[0] - env.arena.goals[0])
    assert reward == pytest.approx(-distance, abs=1e-9)


def test_a_checkpoint_of_another_rate_or_robot_is_refused(tmp_path):
    with pytest.raises(JointMismatch, match=r"50 Hz.*100 Hz"):
        DynamicsSpec("ErgoReacher", checkpoint=small_model(tmp_path / "slow", fps=50.0)).stepper(1)
    with pytest.raises(JointMismatch, match="left, right"):
        DynamicsSpec("ErgoReacher", checkpoint=small_model(tmp_path / "other", joints=("left", "right"))).check()


def test_a_checkpoint_of_other_commands_is_refused(tmp_path):
    folder = Path(small_model(tmp_path / "psi", kind="forward"))
    config = json.loads((folder / "config.json").read_text())
    kinds = [".pos"] * (len(TASK.joints) - 1)
    for last, effort in ((".pos", False), (".vel", True)):
        changed = {**config, "commands_effort": effort, "provenance": {"kinds": [*kinds, last]}}
        (folder / "config.json").write_text(json.dumps(changed))
        if last == ".pos":
            DynamicsSpec("ErgoReacher", checkpoint=str(folder)).check()
    with pytest.raises(JointMismatch, match=rf"{TASK.joints[-1]}\.vel; the environment has .*{TASK.joints[-1]}\.pos"):
        DynamicsSpec("ErgoReacher", checkpoint=str(folder)).check()


def test_a_correction_of_another_source_is_refused(tmp_path):
    phi = Path(small_model(tmp_path / "phi"))
    (phi / "source.xml").write_text(TASK.simulator().robot.spec().to_xml())
    DynamicsSpec("ErgoReacher", checkpoint=str(phi)).check()
    with pytest.raises(CheckpointError, match="another source than the one in use"):
        DynamicsSpec("ErgoReacher", "backlash", checkpoint=str(phi)).check()


def test_a_plants_description_follows_the_checkpoint_and_not_its_folder(tmp_path):
    one, other = (small_model(tmp_path / name, gain=gain) for name, gain in (("a", 1.0), ("b", 0.5)))
    moved = small_model(tmp_path / "moved", gain=1.0)
    assert (
        DynamicsSpec("ErgoReacher", checkpoint=one).describe()
        == DynamicsSpec("ErgoReacher", checkpoint=moved).describe()
    )
    assert (
        DynamicsSpec("ErgoReacher", checkpoint=one).describe()
        != DynamicsSpec("ErgoReacher", checkpoint=other).describe()
    )


def test_an_episode_that_reached_its_goal_in_any_step_succeeded(monkeypatch):
    arms = ArmVecEnv(find_task("pusher"), DynamicsSpec("pusher").stepper(2))
    arms.reset()
    steps = count(1)

    def judge(*_: object) -> StepResult:
        reached = next(steps) % 100 == 3
        return StepResult(np.zeros(2), np.zeros(2, bool), np.array([reached, False]))

    monkeypatch.setattr(type(arms.arena.task), "judge", judge)  # 100 steps an episode
    for _ in range(2):  # success is forgotten when the next episode begins
        for _ in range(arms.arena.task.horizon):
            _, _, done, infos = arms.step(np.zeros((2, *arms.action_space.shape)))
        assert done.all()
        assert [info["is_success"] for info in infos] == [True, False]
