"""The paper's tasks: their rules, what their dynamics are, and that one arm and many live through the same."""

from dataclasses import dataclass, field, replace

import mujoco
import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from nas_data import registry
from nas_data.effects.base import add_effects
from nas_data.envs import ergo_shield, pusher, striker
from nas_data.envs.base import find_task
from nas_data.envs.loop.arm_env import ArmEnv
from nas_data.envs.loop.arm_vec_env import ArmVecEnv
from nas_data.envs.loop.dynamics_spec import DynamicsSpec
from nas_data.envs.loop.task_batch import TaskBatch
from nas_data.errors import ModelFileError, OptionError
from nas_data.models.checkpoint import save
from nas_data.models.lstm import DynamicsModel
from nas_data.recorders.recipe import Recipe
from nas_data.robots.base import ConsecutiveEdits, find_robot
from nas_data.robots.ergo_shield import DEFENDERS_JOINTS
from nas_data.studies.experiments.pipeline.authors import DIFFERENCES

GENTLE = 0.3  # actions that throw no joint against its stop, which multiplies the last bits of a network's output
CLOSE = {"atol": 1e-6, "rtol": 1e-5}  # rad and m; fast joints differ by more than 1e-6 rad/s in single precision
TASKS = registry.list_names("envs")


def model_of(task: str, dynamics: str) -> mujoco.MjModel:
    robot, effects = find_task(task).body(dynamics)
    spec = robot.spec()
    add_effects(spec, effects)
    return spec.compile()


def random_states(task: str, dynamics: str, arms: int, steps: int) -> np.ndarray:
    """Return states under random actions, from the task's own starts, shape (steps, arms, 2n)."""
    arms_env = ArmVecEnv(find_task(task), DynamicsSpec(task, dynamics).stepper(arms))
    arms_env.seed(0)
    arms_env.reset()
    rng = np.random.default_rng(0)
    states = []
    for _ in range(steps):
        arms_env.step(rng.uniform(-1, 1, (arms, *arms_env.action_space.shape)))
        states.append(arms_env.arena.stepper.states)
    return np.array(states)


@dataclass
class Scene:
    """A stepper that is told where everything is."""

    sites: dict[str, np.ndarray]
    objects: np.ndarray
    joints: tuple[str, ...] = ()
    calls: list[tuple[str, np.ndarray, np.ndarray]] = field(default_factory=list)

    @property
    def size(self) -> int:
        return len(self.objects)

    def site_positions(self, name: str) -> np.ndarray:
        return self.sites[name]

    def reset(self, states: np.ndarray, rows: np.ndarray) -> None:
        self.calls.append(("reset", states, rows))

    def command_objects(self, targets: np.ndarray, rows: np.ndarray) -> None:
        self.calls.append(("command_objects", targets, rows))


# Every task


@pytest.mark.parametrize("task", TASKS)
def test_every_dynamics_changes_how_the_arm_moves(task):
    moves = {dynamics: random_states(task, dynamics, 2, 60) for dynamics in find_task(task).dynamics}
    for one in moves:
        for other in moves:
            assert one == other or np.abs(moves[one] - moves[other])[-1].max() > 1e-3, f"{one} is {other}"


@pytest.mark.parametrize("task", TASKS)
def test_many_arms_and_one_live_through_the_same_episode_under_phi(task, tmp_path):
    torch.manual_seed(0)
    this = find_task(task)
    effort = set(this.simulator().kinds) != {".pos"}
    model = DynamicsModel("delta", this.joints, hidden=16, layers=2, fps=1 / this.period, commands_effort=effort)
    with torch.no_grad():
        for layer in (model.outer, model.shortcut):
            layer.weight.mul_(0.001)
            layer.bias.mul_(0.001)
    phi = str(save(model, tmp_path / "phi"))
    batch = ArmVecEnv(this, DynamicsSpec(task, checkpoint=phi).stepper(4))
    alone = ArmEnv(task, checkpoint=phi)
    batch.seed(3)
    batch.reset()
    alone.reset(seed=3 + 2)
    rng = np.random.default_rng(0)
    for _ in range(min(this.horizon, 200)):
        actions = rng.uniform(-GENTLE, GENTLE, (4, *batch.action_space.shape))
        seen, rewards, dones, infos = batch.step(actions)
        observation, reward, terminated, truncated, _ = alone.step(actions[2])
        assert rewards[2] == pytest.approx(reward, abs=1e-5)
        if dones[2]:
            assert terminated or truncated
            np.testing.assert_allclose(infos[2]["terminal_observation"], observation, **CLOSE)
            return
        np.testing.assert_allclose(seen[2], observation, **CLOSE)
        np.testing.assert_allclose(batch.arena.stepper.states[2], alone.arena.stepper.states[0], **CLOSE)


@pytest.mark.parametrize("task", TASKS)
def test_the_same_seed_gives_the_same_bits(task):
    dynamics = [*find_task(task).dynamics][:2][-1]  # a target; the source if there is none
    np.testing.assert_array_equal(random_states(task, dynamics, 2, 40), random_states(task, dynamics, 2, 40))


@pytest.mark.parametrize(("task", "joints"), [("pusher", 1), ("striker", 3), ("ergo_reacher", 2), ("ergo_shield", 6)])
def test_the_backlash_is_free_play_in_as_many_joints_as_the_paper_says(task, joints):
    model = model_of(task, "backlash")
    plays = [j for j in range(model.njnt) if model.joint(j).name.endswith("_play")]
    assert len(plays) == joints
    for play in plays:
        low, high = model.jnt_range[play]
        assert model.jnt_limited[play] and low == -high and high >= 0.05
        assert not model.jnt_stiffness[play]


@pytest.mark.parametrize(
    ("task", "arm", "thing"),
    [("pusher", "link2", "puck"), ("striker", "upper_arm", "ball"), ("ergo_reacher", "link5", None)],
)
def test_the_bigger_gap_is_that_of_the_appendix(task, arm, thing):
    small, big = model_of(task, "backlash"), model_of(task, "bigger-gap")
    factors = {arm: 1.5} | ({thing: 2.0} if thing else {})
    for body, factor in factors.items():
        assert big.body(body).mass == pytest.approx(factor * small.body(body).mass)
        assert big.body(body).inertia == pytest.approx(factor * small.body(body).inertia)
    if thing:
        assert big.joint(f"{thing}_x").damping == pytest.approx(6 * small.joint(f"{thing}_x").damping)


# Pusher


def test_the_paper_s_pusher_hangs_where_the_authors_did():
    """The statistics by which their models were normalised: of random actions on their target, in MuJoCo 1.31."""
    states = random_states("pusher", "paper", 100, 100).reshape(-1, 6)
    assert states.mean(axis=0) == pytest.approx([-0.442, 1.508, -0.026, -0.056, 0.392, 0.038], abs=0.2)


def test_with_heavier_links_it_hangs_where_their_later_code_lets_it(monkeypatch):
    """Theirs with links of density 1000 in MuJoCo 4: mean angles −0.54, 1.55, −0.12 rad, speeds −0.11, 0.41, −0.01."""

    def weigh(spec):
        for name in ("link1", "link2", "link3"):
            spec.geom(name).density = 1000

    monkeypatch.setitem(pusher.TASK.edits, "paper", ConsecutiveEdits(weigh, pusher.TASK.edits["paper"]))
    states = random_states("pusher", "paper", 100, 100).reshape(-1, 6)
    assert states[:, :3].mean(axis=0) == pytest.approx([-0.54, 1.55, -0.12], abs=0.12)
    assert states[:, 3:].mean(axis=0) == pytest.approx([-0.11, 0.41, -0.01], abs=0.06)


@given(st.integers(0, 2**32 - 1))
def test_a_puck_and_its_goal_start_apart_and_in_their_ranges(seed):
    start = pusher.TASK.start(np.random.default_rng(seed))
    y, x = start.objects[:2]
    assert 0.3 <= x <= 1.2 and -1 <= y <= -0.4 and not start.objects[2:].any()
    assert 0.8 <= start.goal[0] <= 1.2 and -1.2 <= start.goal[1] <= -0.8
    assert np.hypot(*(start.goal - (x, y))) > 0.45
    assert np.abs(start.state[:3]).max() <= 0.1 and not start.state[3:].any()


def test_the_pusher_s_reward_is_the_authors_sum():
    scene = Scene(sites={"gripper": np.array([[0.6, -0.7, -0.075]])}, objects=np.array([[-0.7, 0.9, 0.0, 0.0]]))
    verdict = pusher.TASK.judge(scene, np.array([[1.0, -1.0]]), np.array([[1.0, 0.0, -0.5]]))
    expected = -np.linalg.norm([0.1, 0.3, 0.045]) - 0.1 * 9 * 1.25 - 0.5 * np.linalg.norm([0.3, 0, 0.025])
    assert verdict.reward[0] == pytest.approx(expected)
    assert not verdict.terminated[0] and not verdict.success[0]


def test_the_arm_pushes_the_puck():
    arena = TaskBatch(pusher.TASK, DynamicsSpec("pusher").stepper(1))
    arena.start([np.random.default_rng(0)])
    puck = np.array([[*np.zeros(6), -0.45, 0.65, 0.0, 0.0]])  # in front of the fork
    arena.stepper.reset(puck)
    for _ in range(100):
        arena.stepper.step(np.array([[-2.0, 0.0, 0.0]]))
    assert np.hypot(*(arena.stepper.objects[0, :2] - puck[0, 6:8])) > 0.1


# Striker


def test_the_paper_s_striker_has_two_joints_pinned():
    """Theirs settle at +1.80 and +1.335 rad, the wrist outside its own range."""
    states = random_states("striker", "paper", 20, 100)[20:].reshape(-1, 14)
    assert np.median(states[:, 0]) == pytest.approx(1.80, abs=0.01)
    assert np.median(states[:, 5]) == pytest.approx(1.335, abs=0.02)


def test_play_takes_the_striker_no_further_beyond_its_stops_than_torque_does():
    """A source that is set to a posture beyond its stops is thrown out of it: such a gap is no backlash."""
    outside, (low, high) = {}, model_of("striker", "source").jnt_range[:7].T
    for dynamics in ("source", "backlash"):
        recipe = Recipe(environment="striker", dynamics=dynamics, episodes=60, steps=100, holds=(1, 5, 20))
        positions = recipe.record()[0].states[:, :7]
        outside[dynamics] = np.mean((positions < low - 0.05) | (positions > high + 0.05), axis=0)
    assert outside["source"].max() < 0.02
    assert np.all(outside["backlash"] < outside["source"] + 0.01)


def test_the_striker_remembers_the_least_distance_and_the_last_touch():
    scene = Scene(sites={"tip": np.array([[0.5, -0.9, -0.2]])}, objects=np.array([[-0.175, 0.5, 0.0, 0.0]]))
    goals = striker.TASK.start(np.random.default_rng(0)).goal[None]
    goals[0, :2] = [0.5, 0.5]
    first = striker.TASK.follow(scene, goals, np.ones(1))
    assert first[0, 2] == pytest.approx(np.hypot(0.675, 0.053)) and first[0, 3] == 0
    away = np.linalg.norm([0.725, 0.07])
    reward = striker.TASK.judge(scene, first, np.ones((1, 7))).reward[0]
    assert reward == pytest.approx(-3 * first[0, 2] - 0.1 * 63 - 0.5 * away)
    scene.sites["tip"] = np.array([[0.5, -0.2, -0.2]])  # 7 cm from the ball: struck from here
    second = striker.TASK.follow(scene, first, np.ones(1))
    scene.sites["tip"], scene.objects = np.array([[0.0, 0.0, 0.0]]), np.array([[0.5, 0.5, 0.0, 0.0]])
    third = striker.TASK.follow(scene, second, np.ones(1))
    scene.objects = np.array([[0.9, 0.5, 0.0, 0.0]])  # past the goal: the least distance counts
    last = striker.TASK.follow(scene, third, np.ones(1))
    verdict = striker.TASK.judge(scene, last, np.zeros((1, 7)))
    away = np.linalg.norm([0.0, 1.1, 0.07])
    assert verdict.reward[0] == pytest.approx(-3 * 0.053 - 0.5 * away) and verdict.success[0]


# ErgoReacher as the authors simulated it


@pytest.mark.parametrize("dynamics", ["paper-source", "paper"])
def test_the_authors_arm_takes_a_step_as_long_as_theirs(dynamics):
    """Theirs after 5, 10, 20 and 50 control steps; the target's joints differ, so that it has ranges."""
    bounds = {
        "paper-source": ([0.20, 0.33, 0.44, 0.50], [0.20, 0.33, 0.44, 0.50]),
        "paper": ([0.17, 0.26, 0.42, 0.50], [0.20, 0.33, 0.44, 0.50]),
    }[dynamics]
    simulator = find_task("ergo_reacher").simulator(dynamics)
    played = np.tile([0, 0, 0.5, 0, 0.5, 0.5], (1, 50, 1))
    angles = simulator.rollout(np.zeros((1, 12)), played)[0, [4, 9, 19, 49]][:, [2, 4, 5]]
    assert (angles > np.array(bounds[0])[:, None] - 0.04).all(), angles
    assert (angles < np.array(bounds[1])[:, None] + 0.04).all(), angles


def test_the_authors_motors_weigh_what_they_say():
    for dynamics, mass in (("paper-source", 0.1), ("paper", 0.2)):
        model = model_of("ergo_reacher", dynamics)
        assert [model.body(f"link{i}").mass[0] for i in range(2, 7)] == pytest.approx([mass] * 5, abs=0.005)
        assert model.actuator_forcerange == pytest.approx(np.tile([-1, 1], (6, 1)))


# ErgoShield as the authors had it


@pytest.fixture(scope="module")
def protocol():
    """Commands of 40 episodes of three targets [rad], each held for a second, shape (40, 300, 6)."""
    return np.random.default_rng(0).uniform(-np.pi / 2, np.pi / 2, (40, 3, 6)).repeat(100, axis=1)


def angles_of(dynamics: str, commands: np.ndarray) -> np.ndarray:
    simulator = find_task("ergo_shield").simulator(dynamics)
    return simulator.rollout(np.zeros((len(commands), 24)), commands)[:, :, :6]


def test_the_arm_of_the_authors_moves_as_their_recordings_show(protocol):
    angles = angles_of("paper", protocol)
    speeds = np.degrees(np.abs(np.diff(angles, axis=1))) * 100
    assert 95 < np.median(speeds[speeds > 50]) < 125  # [°/s]
    far = np.abs(protocol[:, 0]) > 0.5
    moved = np.abs(angles[:, :100] - angles[:, :1]) > np.radians(0.29)  # [rad] a unit of the servo's
    first = 0.01 * (moved.argmax(axis=1) + 1)[far]
    assert 0.07 < np.median(first) < 0.115  # [s]
    rest = np.abs(angles[:, 99] - protocol[:, 99])[np.abs(protocol[:, 0]) < 1.2]
    assert 0.8 < np.degrees(np.median(rest)) < 1.3


def test_the_authors_source_is_as_wrong_of_their_arm_as_it_was(protocol):
    """Their table 1: mean of the squared differences, in units of 90°, and its quartiles."""
    apart = np.square((angles_of("paper", protocol) - angles_of("paper-source", protocol)) / (np.pi / 2))
    differences = apart.mean(axis=1).ravel()
    quartile, mean, third = DIFFERENCES["source"].values
    assert differences.mean() == pytest.approx(mean, rel=0.15)
    assert np.quantile(differences, 0.25) == pytest.approx(quartile, rel=0.3)
    assert np.quantile(differences, 0.75) == pytest.approx(third, rel=0.15)


@pytest.mark.parametrize("dynamics", ["paper", "paper-source"])
def test_the_opponent_is_the_same_whatever_the_authors_arm_is(dynamics):
    ours, theirs = model_of("ergo_shield", "source"), model_of("ergo_shield", dynamics)
    for joint in DEFENDERS_JOINTS:
        assert theirs.actuator(joint).gainprm == pytest.approx(ours.actuator(joint).gainprm)
        assert theirs.joint(joint).damping == pytest.approx(ours.joint(joint).damping)
    assert theirs.actuator("m2").gainprm[0] != ours.actuator("m2").gainprm[0]


@pytest.mark.bullet
def test_a_constraint_is_refused_where_the_engine_cannot_keep_it():
    with pytest.raises(ModelFileError, match="equality constraints"):
        DynamicsSpec("Pusher", "paper", engine="bullet").simulator()


# ErgoShield


def duel(sword_y: float) -> Scene:
    """A scene whose sword stands upright through the shield's middle at some distance before it."""
    return Scene(
        sites={
            "sword_top": np.array([[0.0, sword_y, 0.25]]),
            "sword_bottom": np.array([[0.0, sword_y, 0.10]]),
            "defender_shield_centre": np.array([[0.0, 0.2, 0.156]]),
            "defender_shield_front": np.array([[0.0, -0.8, 0.156]]),
        },
        objects=np.zeros((1, 12)),
    )


@settings(deadline=None)
@given(st.floats(-0.02, 0.02), st.floats(-0.1, 0.1))
def test_a_touch_is_told_by_the_distance_of_sword_and_disc(forward, sideways):
    scene = duel(0.2 + forward)
    for site in ("sword_top", "sword_bottom"):
        scene.sites[site][0, 0] = sideways
    beside, before = max(abs(sideways) - 0.0235, 0), max(abs(forward) - 0.0025, 0)
    gap = np.hypot(beside, before) - 0.0035
    if abs(gap) > 2e-4:  # points along the sword are 5 mm apart
        assert ergo_shield.detect_touches(scene)[0] == (gap < 0)


def test_a_hit_counts_once_parts_the_arms_and_gives_the_defender_another_pose():
    task, far, near = ergo_shield.TASK, duel(0.1), duel(0.2)
    goals = task.start(np.random.default_rng(0)).goal[None]
    poses = goals[0, 5:-32].reshape(-1, 6)
    assert (np.abs(poses) <= np.radians([45, 15, 15, 22.5, 15, 15])).all()
    goals = task.follow(near, goals, np.ones(1))
    assert task.judge(near, goals, goals).reward[0] == 0, "an episode that begins in touch has no hit yet"
    goals = task.follow(near, task.follow(far, goals, np.ones(1)), np.ones(1))
    assert task.judge(near, goals, goals).reward[0] == 1
    (what, states, rows) = near.calls[-1]
    assert (what, rows.tolist()) == ("reset", [0])
    np.testing.assert_array_equal(states[0], [*np.zeros(12), *poses[1], *np.zeros(6)])
    goals = task.follow(near, goals, np.ones(1))
    assert task.judge(near, goals, goals).reward[0] == 0
    assert len(near.calls) == 1 and task.judge(near, goals, goals).success[0]


def test_the_defender_takes_another_pose_every_two_and_a_half_seconds():
    task, far = ergo_shield.TASK, duel(0.1)
    goals = task.start(np.random.default_rng(0)).goal[None]
    for step in range(1, 1001):
        goals = task.follow(far, goals, np.array([step]))
    assert [call[0] for call in far.calls] == ["command_objects"] * 4
    np.testing.assert_array_equal(far.calls[1][1][0], goals[0, 5:-32].reshape(-1, 6)[2])


def test_as_many_touches_are_missed_as_is_said():
    far, near, rng = duel(0.1), duel(0.2), np.random.default_rng(0)
    for share in (0.0, 0.125, 1.0):
        task, hits = replace(ergo_shield.TASK, missed=share), 0.0
        for _ in range(40):
            goals = task.start(rng).goal[None]
            for step in range(1, 61):
                goals = task.follow(near if step % 2 else far, task.follow(far, goals, np.ones(1)), np.ones(1))
                hits += float(task.judge(near, goals, goals).reward[0])
        assert 1 - hits / 1200 == pytest.approx(share, abs=0.03)


def test_missed_touches_are_an_option_of_the_environment():
    def hits(**options: float) -> float:
        env = ArmEnv("ErgoShield", **options)
        env.reset(seed=0)
        rng = np.random.default_rng(0)
        return sum(env.step(rng.uniform(-1, 1, 6))[1] for _ in range(1000))

    assert hits() == hits(missed=0.0) > 0
    assert hits(missed=1.0) == 0
    assert DynamicsSpec("ErgoShield", missed=0.125).describe()["missed"] == 0.125
    assert "missed" not in DynamicsSpec("ErgoShield").describe()
    with pytest.raises(OptionError, match=r"The share of missed touches is 1.5; it must be in"):
        DynamicsSpec("ErgoShield", missed=1.5).task  # noqa: B018
    with pytest.raises(OptionError, match="ErgoReacher has no touches to miss"):
        DynamicsSpec("ErgoReacher", missed=0.1).task  # noqa: B018


def test_random_actions_hit_now_and_then():
    """The authors: two hits in 1000 steps."""
    arms = ArmVecEnv(ergo_shield.TASK, DynamicsSpec("ErgoShield").stepper(8))
    arms.seed(0)
    arms.reset()
    rng = np.random.default_rng(0)
    for _ in range(1000):
        arms.step(rng.uniform(-1, 1, (8, 6)))
    hits = [episode.total for episode in arms.take_episodes()]
    assert len(hits) == 8 and 0.5 < np.mean(hits) < 6


@pytest.mark.bullet
def test_the_duel_runs_on_the_other_engine():
    env = ArmEnv("ErgoShield", engine="bullet")
    seen, _ = env.reset(seed=0)
    other, _ = ArmEnv("ErgoShield").reset(seed=0)
    np.testing.assert_allclose(seen, other, atol=1e-6)
    for _ in range(30):
        seen, *_ = env.step(np.full(6, 0.3))
    assert env.observation_space.contains(seen) and seen[:6].max() > 0.1


def test_the_scene_s_robot_is_the_ergojr_with_more_in_its_hand():
    alone, armed = (find_robot(name).spec().compile() for name in ("ergojr_penholder", "ergo_shield"))
    assert armed.body("penholder").mass[0] == pytest.approx(alone.body("penholder").mass[0] + 0.006)
