"""How episodes began: the hidden states at their first row, told by what followed."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from support.evidence_samples import QUANTUM, commanded

import nas_data as nas
from nas_data.dataset.features import ENVIRONMENT
from nas_data.effects.base import Effect, parse
from nas_data.envs.base import find_task
from nas_data.gap.episode_batch import EpisodeBatch
from nas_data.gap.finding.find import find
from nas_data.gap.finding.joint_gaps import find_joint_gaps
from nas_data.gap.finding.recorded import RecordedRows
from nas_data.gap.nominal import Nominal
from nas_data.gap.problem import Problem
from nas_data.gap.search.objective import FitTask
from nas_data.gap.windows import cut_window
from nas_data.gap.write_model import write_model
from nas_data.models.evaluation import evaluate
from nas_data.recorders.recipe import Recipe
from nas_data.simulators.initial_states import InitialLoad
from nas_data.simulators.mujoco import MujocoSimulator
from nas_data.studies.experiments.pipeline.sizes import RECORDINGS

FLOOR = np.full(6, QUANTUM / np.sqrt(12))


def played(effect: Effect, hold: InitialLoad) -> tuple[Nominal, EpisodeBatch]:
    """What the ErgoJr with an effect measures from poses that it held in one way."""
    evidence = commanded(episodes=4)
    poses = np.random.default_rng(1).uniform(-0.5, 0.5, (4, 6))
    evidence = replace(evidence, initial_positions=poses).with_initial_loads(hold)
    nominal = Nominal.load("ergojr", evidence)
    positions = nominal.predict(evidence, [effect])
    return nominal, replace(evidence, measured=np.round(positions / QUANTUM) * QUANTUM).with_initial_loads(
        InitialLoad.GRAVITY
    )


@pytest.mark.parametrize("hold", list(InitialLoad))
@pytest.mark.parametrize("text", ["backlash:joint=m2,half_width=0.05", "speed_limit:joint=m2,speed=1.0"])
def test_the_start_is_told_by_the_first_second(text: str, hold: InitialLoad):
    effect = parse(text)
    nominal, evidence = played(effect, hold)
    told = FitTask(nominal, evidence, FLOOR).infer_initial_loads([effect], {})
    assumed = np.sqrt(evidence.mean_squares(nominal.predict(evidence, [effect])))[:, 1] / FLOOR[1]
    rest = np.sqrt(told.evidence.mean_squares(nominal.predict(told.evidence, [effect])))[:, 1] / FLOOR[1]
    assert np.all(rest < 1.5)
    assert hold != InitialLoad.UNLOADED or (assumed > 1.5).any(), "the assumption matters, or this test shows nothing"


def test_a_model_without_memory_has_one_start():
    effect = parse("coulomb_friction:joint=m2,torque=0.02")
    nominal, evidence = played(effect, InitialLoad.UNLOADED)
    task = FitTask(nominal, evidence, FLOOR)
    assert not nominal.simulator([effect]).remembers
    assert (task.infer_initial_loads([effect], {}).evidence.initial_loads == InitialLoad.GRAVITY).all()
    positions = [nominal.predict(evidence.with_initial_loads(hold), [effect]) for hold in InitialLoad]
    assert all(np.array_equal(positions[0], other) for other in positions)


@pytest.mark.parametrize("hold", [InitialLoad.GRAVITY, InitialLoad.UNLOADED])
def test_gap_find_and_evaluate_begin_alike(hold: InitialLoad, tmp_path: Path):
    effect = parse("joint_compliance:joint=m2,stiffness=0.8")
    nominal, evidence = played(effect, hold)
    path, _ = write_model(tmp_path, nominal, [effect], {}, timestep=float(nominal.spec.option.timestep))
    positions = [np.vstack(rows) for rows in zip(evidence.initial_positions, evidence.measured, strict=True)]
    dataset = nas.Dataset.from_arrays(
        positions, list(evidence.commands), rate=1 / evidence.period, joints=evidence.joints
    )
    problem = Problem.of(dataset, path, tmp_path)
    found = find(dataset, problem.evidence, problem.as_given, problem.train.floor)
    simulator = MujocoSimulator.load(path, evidence.period, evidence.joints)
    judged = evaluate(dataset, simulator, None).open_loop["source"]
    gaps = np.array([found.joints[joint].open_loop for joint in evidence.joints])
    np.testing.assert_allclose(gaps, np.sqrt(judged.squared[:, :6].mean(0)), rtol=0.02)
    assert gaps[1] < 2 * FLOOR[1], "neither is right"


# Scenes


@cache
def scene(name: str, dynamics: str = "backlash") -> Problem:
    """An environment's target, recorded by its recipe, with the source as model."""
    holds = {"ergo_reacher": (1, 5, 20, 100), "ergo_shield": (100, 20, 5, 1)}.get(name, (1, 2, 5, 20))
    recipe = Recipe(environment=name, dynamics=dynamics, episodes=4, steps=RECORDINGS[name].steps, holds=holds)
    return Problem.of(recipe.record()[0], name, Path(name))


def errors(problem: Problem, evidence: EpisodeBatch, effects: tuple[Effect, ...]) -> np.ndarray:
    """Root mean squared error of each joint [rad], episodes begun as their first second tells, shape (n,)."""
    nominal = problem.train.nominal
    begun = FitTask(nominal, evidence, problem.train.floor).infer_initial_loads(effects, {}).evidence
    return np.sqrt(begun.mean_squares(nominal.predict(begun, effects)).mean(axis=0))


@pytest.mark.parametrize(
    ("name", "most"), [("striker", 1e-4), ("pusher", 1e-4), ("ergo_shield", QUANTUM / np.sqrt(12))]
)
def test_the_true_target_of_a_scene_leaves_what_its_sensors_leave(name: str, most: float):
    problem, effects = scene(name), find_task(name).effects("backlash")
    evidence = problem.evidence
    assert np.all(errors(problem, evidence, effects) < 1.1 * most)
    at_rest = replace(
        evidence, initial_velocities=np.zeros_like(evidence.initial_velocities), objects=evidence.objects[..., :0]
    )
    assert np.max(errors(problem, at_rest, effects)) > 5 * most, "starts make no difference: this test shows nothing"


@pytest.mark.parametrize("name", ["striker", "pusher", "ergo_shield"])
def test_a_written_model_takes_the_scene_s_objects_as_the_effects_do(name: str, tmp_path: Path):
    problem, effects = scene(name), find_task(name).effects("backlash")
    nominal, held = problem.held.nominal, problem.held.evidence
    path, _ = write_model(tmp_path, nominal, effects, {}, timestep=float(nominal.spec.option.timestep))
    written = Nominal.load(path, held).predict(held)
    apart = written - nominal.predict(held, effects)
    assert np.sqrt(np.mean(apart**2)) < 1e-3  # numbers of six digits, and joints thrown against their stops


def test_the_one_step_gap_of_the_source_is_none_in_contacts_either():
    problem = scene("pusher", "source")
    recorded = RecordedRows.of(problem.dataset, problem.evidence)
    nominal = problem.train.nominal
    gaps = find_joint_gaps(recorded, nominal, problem.train.floor, nominal.predict(problem.evidence))
    assert max(gap.one_step for gap in gaps.values()) < 1e-6
    assert max(gap.open_loop for gap in gaps.values()) < 1e-4


def test_a_window_starts_with_the_objects_where_they_were_then():
    problem = scene("pusher")
    pucks = [problem.dataset.columns[ENVIRONMENT][rows] for rows in problem.dataset.episodes()]
    pushed = int(np.argmax([np.abs(rows[40] - rows[0]).max() for rows in pucks]))
    objects = pucks[pushed]
    assert np.abs(objects[40] - objects[0]).max() > 0.01, "no puck was touched: this test shows nothing"
    part = cut_window(problem.evidence, pushed, 40, 30)
    assert np.array_equal(part.initial[0, 6:], objects[40])
    assert np.array_equal(part.objects[0], objects[40:70])


@pytest.mark.parametrize("name", ["striker", "pusher", "ergo_shield"])
def test_settled_under_nothing_is_at_rest_objects_and_all(name: str):
    problem, effects = scene(name), find_task(name).effects("backlash")
    evidence = problem.evidence.select([0, 1])
    simulator = problem.train.nominal.simulator(effects)
    holds = np.full(evidence.initial_positions.shape, InitialLoad.UNLOADED)
    rested, settled = simulator.rest(evidence.initial), simulator.settled(evidence.initial, holds)
    np.testing.assert_allclose(settled, rested, atol=1e-9)
