"""Scenes: what moves beside the measured arm is read, reset, recorded and paired like the arm itself."""

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from support.linear_samples import silent
from support.training_samples import TINY

from nas_data import registry
from nas_data.cli import main
from nas_data.dataset.features import ENVIRONMENT, NEXT_ENVIRONMENT, SIM_ENVIRONMENT
from nas_data.dataset.read import read
from nas_data.dataset.verify import verify
from nas_data.envs.base import Task, find_task
from nas_data.errors import JointMismatch
from nas_data.models.augmented import LearnedStepper
from nas_data.models.losses import FreeRunning, estimate_jacobians
from nas_data.models.lstm import DynamicsModel
from nas_data.models.training import ModelTraining
from nas_data.pairing import describe_missing_objects, pair, read_scene_states
from nas_data.recorders.recipe import Recipe
from nas_data.robots.base import find_robot
from nas_data.simulators.base import Simulator
from nas_data.simulators.engines import load_simulator
from nas_data.simulators.mujoco import MujocoSimulator

TABLE = Path(__file__).parents[1] / "support/table.xml"
SCENES = [name for name in registry.list_names("envs") if find_task(name).simulator().object_feature.width]


def starts(task: Task, count: int) -> np.ndarray:
    """Return first states with objects, shape (count, 2n + m)."""
    drawn = [task.start(np.random.default_rng(seed)) for seed in range(count)]
    return np.stack([np.concatenate([start.state, start.objects]) for start in drawn])


def commands(task: Task, count: int, steps: int) -> np.ndarray:
    """Return commands of random actions, shape (count, steps, n)."""
    actions = np.random.default_rng(1).uniform(-1, 1, (count * steps, *task.action_space.shape))
    return task.command(actions).reshape(count, steps, -1)


@pytest.fixture(scope="module")
def paired(tmp_path_factory) -> Path:
    """Pusher's target recorded as its episodes begin, paired with the source."""
    folder = tmp_path_factory.mktemp("pusher")
    recorded, out = folder / "recorded", folder / "paired"
    assert main(["record", "sim", "--env", "Pusher", "--episodes", "12", "--out", str(recorded)]) == 0
    assert main(["pair", str(recorded), "--model", "pusher", "--out", str(out)]) == 0
    return out


def test_the_scenes_are_those_of_the_paper_with_objects():
    assert SCENES == ["ergo_shield", "pusher", "striker"]


@pytest.mark.parametrize("name", SCENES)
def test_a_closed_loop_is_the_rollout_of_its_commands(name):
    task = find_task(name)
    simulator = task.simulator()
    first, played = starts(task, 3), commands(task, 3, 40)
    rolled = simulator.rollout(first, played)
    stepper = simulator.stepper(3)
    stepper.reset(first)
    np.testing.assert_array_equal(stepper.objects, first[:, 2 * len(task.joints) :])
    for step in range(40):
        states = stepper.step(played[:, step])
        np.testing.assert_allclose(np.concatenate([states, stepper.objects], axis=1), rolled[:, step], atol=1e-12)


@pytest.mark.parametrize("name", SCENES)
def test_without_objects_a_state_means_their_reference(name):
    task = find_task(name)
    simulator, n = task.simulator(), len(task.joints)
    reference = simulator.stepper(2).objects
    first, played = starts(task, 2)[:, : 2 * n], commands(task, 2, 5)
    whole = simulator.rollout(np.concatenate([first, reference], axis=1), played)
    np.testing.assert_array_equal(simulator.rollout(first, played), whole[..., : 2 * n])


def test_a_state_of_another_width_is_refused():
    with pytest.raises(JointMismatch, match=r"7 and commands of 3.*6, or 10 with the objects"):
        find_task("pusher").simulator().predict(np.zeros((1, 7)), np.zeros((1, 3)))


def test_free_joints_are_named_and_put_where_they_are_wanted():
    simulator = MujocoSimulator(find_robot(TABLE), 0.02)
    feature = simulator.object_feature
    places, speeds = "x y z qw qx qy qz".split(), "x y z wx wy wz".split()  # noqa: SIM905 (shorter than two lists)
    assert feature.names[:8] == (*(f"puck.{part}.pos" for part in places), "goal_x.pos")
    assert feature.names[8:] == (*(f"puck.{part}.vel" for part in speeds), "goal_x.vel")
    assert dict(zip(feature.names, feature.units, strict=True))["puck.wx.vel"] == "rad/s"
    stepper = simulator.stepper(2)
    objects = stepper.objects
    objects[1, :3] = [0.3, -0.2, 0.05]
    stepper.reset(np.concatenate([np.zeros((1, 6)), objects[1:]], axis=1), np.array([1]))
    np.testing.assert_array_equal(stepper.objects, objects)


def test_a_recording_holds_the_objects_before_and_after_each_command(paired):
    dataset = read(paired)
    assert verify(paired) == []
    assert dataset.features[ENVIRONMENT].names == ("puck_y.pos", "puck_x.pos", "puck_y.vel", "puck_x.vel")
    assert dataset.features[ENVIRONMENT].units == ("m", "m", "m/s", "m/s")
    now, after = dataset.columns[ENVIRONMENT], dataset.columns[NEXT_ENVIRONMENT]
    for rows in dataset.episodes():
        np.testing.assert_array_equal(now[rows][1:], after[rows][:-1])
    places = now[dataset.starts]
    assert (np.abs(places[:, 0] + 0.7) <= 0.3).all() and (np.abs(places[:, 1] - 0.75) <= 0.45).all()
    assert len(np.unique(places[:, 0])) == dataset.n_episodes
    assert (np.abs(after - now).max(axis=1) > 0).any(), "no puck was touched: the recording shows nothing"


def test_pairing_equals_a_plain_loop_over_mj_step_bit_for_bit(paired):
    dataset = read(paired)
    simulator = find_task("pusher").simulator()
    assert isinstance(simulator, MujocoSimulator)
    model, data = simulator.model, mujoco.MjData(simulator.model)
    joints = [model.joint(name).qposadr[0] for name in dataset.joints]
    objects = [model.joint(name).qposadr[0] for name in ("puck_y", "puck_x")]
    moved = np.flatnonzero(np.abs(dataset.columns[NEXT_ENVIRONMENT] - dataset.columns[ENVIRONMENT]).max(axis=1) > 0)
    for row in [*range(100), *moved[:100]]:
        mujoco.mj_resetData(model, data)
        data.qpos[joints], data.qvel[joints] = np.split(dataset.states[row], 2)
        data.qpos[objects], data.qvel[objects] = np.split(dataset.columns[ENVIRONMENT][row], 2)
        data.ctrl[:] = dataset.commands[row]
        mujoco.mj_step(model, data, simulator.substeps)
        scene = np.concatenate([data.qpos[objects], data.qvel[objects]])
        np.testing.assert_array_equal(dataset.columns[SIM_ENVIRONMENT][row], scene.astype(np.float32))
        states = np.concatenate([data.qpos[joints], data.qvel[joints]])
        np.testing.assert_array_equal(dataset.sim_states[row], states.astype(np.float32))


def test_a_source_without_the_dataset_s_objects_starts_from_its_reference_and_says_so(paired):
    dataset, source = read(paired), find_task("striker").simulator()
    assert describe_missing_objects(dataset, find_task("pusher").simulator()) == []
    assert "lacks ball_y.pos" in describe_missing_objects(dataset, source)[0]
    np.testing.assert_array_equal(read_scene_states(dataset, source), dataset.states)


def test_options_that_an_environment_brings_itself_are_refused(capsys):
    assert main(["record", "sim", "--env", "Pusher", "--rate", "50"]) == 2
    assert "--rate cannot be combined with --env" in capsys.readouterr().err
    assert main(["record", "sim", "--env", "Pusher", "--robot", "pendulum"]) == 2
    assert "--robot cannot be combined with --env" in capsys.readouterr().err
    assert main(["record", "sim", "--robot", "pendulum", "--dynamics", "bigger-gap"]) == 2
    assert "--dynamics is of an environment; add --env" in capsys.readouterr().err


# The opponent


def shield(engine: str) -> Simulator:
    return find_task("ergo_shield").simulator(engine=engine)


@pytest.mark.parametrize("engine", ["mujoco", pytest.param("bullet", marks=pytest.mark.bullet)])
def test_an_opponent_holds_its_pose_until_it_is_guided(engine):
    stepper = shield(engine).stepper(2)
    posed = np.concatenate([np.zeros((2, 12)), np.full((2, 6), 0.2), np.zeros((2, 6))], axis=1)
    stepper.reset(posed)
    for _ in range(60):
        stepper.step(np.zeros((2, 6)))
    np.testing.assert_allclose(stepper.objects[:, :6], 0.2, atol=0.12)  # the servos sag under the arm's weight
    stepper.command_objects(np.full((1, 6), -0.2), np.array([1]))
    for _ in range(60):
        stepper.step(np.zeros((2, 6)))
    assert (stepper.objects[0, :6] > 0.05).all() and (stepper.objects[1, [0, 3, 4, 5]] < -0.05).all()
    stepper.reset(posed[:1], np.array([1]))
    np.testing.assert_allclose(stepper.objects[1], posed[1, 12:], atol=1e-12)


@pytest.mark.bullet
def test_engines_differ_a_little_and_agree_on_the_scene():
    task = find_task("ergo_shield")
    first, played = starts(task, 2), commands(task, 2, 1).repeat(50, axis=1)
    ends = [shield(engine).rollout(first, played)[:, -1] for engine in ("mujoco", "bullet")]
    assert 1e-4 < np.abs(ends[0] - ends[1])[:, :6].max() < 0.3
    np.testing.assert_allclose(ends[0][:, 12:18], ends[1][:, 12:18], atol=0.1)


# Learned models


@pytest.mark.parametrize("kind", ["delta", "forward"])
@pytest.mark.parametrize("name", SCENES)
def test_a_learned_model_moves_the_joints_and_leaves_the_objects_to_the_source(name, kind):
    task = find_task(name)
    model = DynamicsModel(kind, task.joints, hidden=8, layers=1, fps=1 / task.period)
    for parameter in model.parameters():
        parameter.data.zero_()
    first, played = starts(task, 2), commands(task, 2, 10)
    stepper, plain = LearnedStepper(task.simulator().stepper(2), model), task.simulator().stepper(2)
    for each in (stepper, plain):
        each.reset(first)
    for step in range(10):
        stepper.step(played[:, step])
        if kind == "forward":
            plain.set_states(first[:, : 2 * len(task.joints)])
        plain.step(played[:, step])
        np.testing.assert_allclose(stepper.objects, plain.objects, atol=1e-9)
    if kind == "forward":
        np.testing.assert_allclose(stepper.states, first[:, : 2 * len(task.joints)], atol=1e-6)


@pytest.mark.usefixtures("one_thread")
@pytest.mark.parametrize(
    ("name", "dynamics", "most"),
    [("pusher", "source", 1e-10), ("pusher", "backlash", 1e-10), ("ergo_shield", "backlash", 3e-3)],  # a quantum's
)
def test_while_phi_runs_freely_objects_are_where_they_were_measured(name, dynamics, most):
    """A silent φ on the true source has nothing to learn, in windows with contacts and beside a guarding opponent."""
    simulator = find_task(name).simulator(dynamics)
    recorded, _ = Recipe(environment=name, dynamics=dynamics, episodes=8, steps=60, holds=(20,)).record()
    paired = pair(recorded, simulator)
    training = ModelTraining("delta", paired, replace(TINY, updates=40), simulator, device="cpu")
    silent(training.model)
    for update in (0, 20, 39):
        assert float(training.phase.loss(update).detach()) < most
    assert isinstance(training.phase, FreeRunning) and training.phase.jacobians is not None
    slopes = torch.cat(training.phase.jacobians)
    rows = training.split.train
    states, simulated = read_scene_states(rows, simulator).astype(float), rows.sim_states.astype(float)
    if simulator.remembers:
        simulated = simulator.predict(states, rows.commands)[:, : simulated.shape[1]]
    expected = estimate_jacobians(simulator, states, rows.commands, simulated)
    np.testing.assert_allclose(slopes.numpy(), expected, atol=1e-3)


@given(st.integers(0, 2**31))
@settings(max_examples=10, deadline=None)
def test_a_scene_is_forgotten_at_reset(seed):
    simulator = load_simulator("pusher", 0.05)
    rng = np.random.default_rng(seed)
    first, played = starts(find_task("pusher"), 1), rng.uniform(-3, 3, (5, 1, 3))
    stepper = simulator.stepper(1)
    runs = []
    for _ in range(2):
        stepper.reset(first)
        runs.append([np.concatenate([stepper.step(row), stepper.objects], axis=1) for row in played])
    np.testing.assert_array_equal(*runs)
