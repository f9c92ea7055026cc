"""The hash of our own code: what decides a result changes it, what is said about it does not."""

import ast
import json

import pytest

from nas_data.envs.ergo_reacher import TASK
from nas_data.envs.loop.dynamics_spec import DynamicsSpec
from nas_data.errors import OutputExists
from nas_data.models.checkpoint import save
from nas_data.models.lstm import DynamicsModel
from nas_data.policies.compare import Run, Study, compare
from nas_data.policies.policy import CONFIG, Hyperparameters
from nas_data.policies.ppo import PolicyTraining
from nas_data.runs import code_hash, environment_info
from nas_data.runs.code_hash import list_gap_modules
from nas_data.studies.experiments.pipeline.learning import TRAINED_BY

SMALL = Hyperparameters(arms=2, rollout=32, minibatches=2, epochs=1)


PHI_STEPS = "nas_data.models.inference.onnx_network"  # imported inside a function


def training(environment, dynamics="source"):
    return PolicyTraining(DynamicsSpec(environment, dynamics), 0, 32, SMALL)


@pytest.fixture
def phi(tmp_path):
    """Return a plant that φ corrects."""
    model = DynamicsModel("delta", TASK.joints, hidden=8, layers=1, fps=1 / TASK.period)
    return DynamicsSpec("ErgoReacher", checkpoint=str(save(model, tmp_path / "phi")))


@pytest.mark.parametrize(
    ("module", "old", "new"),
    [
        ("nas_data.envs.pusher", "EFFORT_COST, REACH_COST = 0.1, 0.5", "EFFORT_COST, REACH_COST = 0.1, 0.6"),  # reward
        ("nas_data.envs.pusher", "horizon=100", "horizon=101"),
        ("nas_data.envs.pusher", "START_ANGLE = 0.1", "START_ANGLE = 0.2"),
        ("nas_data.envs.loop.task_batch", "self.elapsed += 1", "self.elapsed += 2"),
        ("nas_data.effects.backlash", "half_width", "width"),
        ("nas_data.policies.ppo", "gae_lambda=p.trace", "gae_lambda=1.0"),
        ("nas_data.policies.ppo", "while learner.done < training.rollouts", "while learner.done <= training.rollouts"),
        ("nas_data.simulators.mujoco", "class MujocoSimulator", "class Renamed"),  # a name counts, too
    ],
)
def test_other_code_is_another_training(edited, module, old, new):
    before = training("Pusher", "backlash").identity()
    edited(module, old, new)
    after = training("Pusher", "backlash").identity()
    assert {key for key in after if after[key] != before[key]} == {"code"}


def test_comments_docstrings_and_layout_do_not_count(edited):
    before = training("Pusher").identity()
    edited("nas_data.envs.pusher", '"""Return torques [N·m], shape (B, 3)."""', '"""Other words."""  # and a remark')
    assert training("Pusher").identity() == before


def test_what_a_training_does_not_use_does_not_count(edited):
    before = training("Pusher").identity()
    edited("nas_data.envs.ergo_reacher", "horizon=", "period=1.0, horizon=")
    assert training("Pusher").identity() == before
    edited("nas_data.effects.backlash", "half_width", "width")
    assert training("Pusher").identity() == before  # the plain source has no backlash


def test_what_steps_phi_decides_policies_that_learn_or_are_judged_on_it(edited, phi):
    def versions():
        plain, learned = (PolicyTraining(plant, 0, 32, SMALL) for plant in (DynamicsSpec("ErgoReacher"), phi))
        judged = Run("source", plain, phi, 2, folder=None).question()
        return learned.identity()["code"], judged["code"], plain.identity()["code"]

    before = versions()
    edited(PHI_STEPS, "class OnnxNetwork", "class Renamed")
    after = versions()
    assert [one != other for one, other in zip(before, after, strict=True)] == [True, True, False]


@pytest.mark.parametrize(
    ("root", "reached"),
    [
        ("nas_data.models.run", PHI_STEPS),  # φ is judged while it is trained
        ("nas_data.gap.workflow", "nas_data.gap.phi_shares"),
        ("nas_data.envs.loop.load_model", "nas_data.models.checkpoint"),
        ("nas_data.envs.base", "nas_data.robots.base"),
    ],
)
def test_imports_inside_functions_count(root, reached):
    assert reached in code_hash.collect(root)


def test_options_of_a_plant_count_only_where_they_are_taken():
    plain = code_hash.collect(*DynamicsSpec("Pusher").modules())
    assert not [name for name in plain if name.startswith(("nas_data.models", "nas_data.gap"))]
    assert "nas_data.simulators.bullet" not in plain and "nas_data.envs.loop.randomised" not in plain
    assert "nas_data.simulators.bullet" in code_hash.collect(*DynamicsSpec("Pusher", engine="bullet").modules())


def test_all_that_a_choosing_module_imports_in_its_functions_is_named_by_some_plant(tmp_path, phi):
    (tmp_path / "effects.json").write_text('{"schema": 1, "effects": [], "retuned": {"m1.damping": 1.1}}')
    plants = (
        DynamicsSpec("ErgoReacher", effects=str(tmp_path / "effects.json")),
        DynamicsSpec("ErgoReacher", randomised=True),
        DynamicsSpec("ErgoReacher", engine="bullet"),
        phi,
    )
    named = code_hash.collect(*(module for plant in plants for module in plant.modules()))
    for module in code_hash.CHOOSING:
        assert inner_imports(f"nas_data.{module}") <= set(named)


def inner_imports(module):
    """Return what the functions of a module import."""
    tree = ast.parse(code_hash.read_source(module))
    found = {
        name
        for statement in code_hash.walk_statements(tree, deep=True)
        for name in code_hash.find_imported_modules(statement)
    }
    assert found > set(code_hash.analyse_module(module)[1])
    return found


def test_the_modules_that_are_treated_otherwise_are_there():
    for part in (*code_hash.APART, *code_hash.CHOOSING):
        assert code_hash.find_file(f"nas_data.{part}"), part


def test_imports_are_found_in_every_block_but_not_those_for_type_checkers():
    tree = ast.parse(SCATTERED)
    for deep, wanted in (
        (True, "runs.stages metrics mjcf.actuator_lookup mjcf.default_servos runs.parallel sources pairing"),
        (False, "runs.stages mjcf.default_servos"),
    ):
        found = {
            name
            for statement in code_hash.walk_statements(tree, deep)
            for name in code_hash.find_imported_modules(statement)
        }
        assert found == {f"nas_data.{word}" for word in wanted.split()}


SCATTERED = """
import nas_data.runs.stages, nas_data.errors, numpy
from typing import TYPE_CHECKING
if TYPE_CHECKING:
    from nas_data.mjcf.bake_inertia import bake_inertia
else:
    from nas_data.mjcf import default_servos
class Thing:
    def load(self):
        try:
            from nas_data.metrics import Errors
        except ImportError:
            from nas_data.mjcf.actuator_lookup import find_driven_joint
        finally:
            with open("x"):
                from nas_data.runs.parallel import run_jobs
        match self:
            case None:
                import nas_data.sources as there
            case _:
                def inner():
                    from nas_data.pairing import pair
                    from nas_data.dataset.read import read
"""


def test_all_that_nas_gap_may_name_decides_what_it_says(edited):
    def versions():
        return code_hash.hash_code(*list_gap_modules()), code_hash.hash_code(TRAINED_BY)

    before = versions()
    edited("nas_data.effects.deadband", "half_width", "width")
    after = versions()
    assert [one != other for one, other in zip(before, after, strict=True)] == [True, False]


def test_a_study_refuses_policies_of_other_code_and_leaves_them_alone(tmp_path, edited):
    study = Study(DynamicsSpec("Pusher"), {"source": DynamicsSpec("Pusher")}, (0,), 32, 2, SMALL)
    first = compare(study, tmp_path, report=lambda _: None)
    held = (tmp_path / "source/seed0" / CONFIG).read_bytes()
    edited("nas_data.envs.pusher", "REACHED = 0.17", "REACHED = 0.18")
    with pytest.raises(OutputExists, match="another version of nas_data"):
        compare(study, tmp_path, report=lambda _: None)
    assert (tmp_path / "source/seed0" / CONFIG).read_bytes() == held
    assert first.results["source", 0].question["code"]


def test_other_code_that_judges_judges_a_kept_policy_again(tmp_path, edited):
    study = Study(DynamicsSpec("Pusher"), {"source": DynamicsSpec("Pusher")}, (0,), 32, 2, SMALL)
    compare(study, tmp_path, report=lambda _: None)
    weights = (tmp_path / "source/seed0/policy.safetensors").stat().st_mtime_ns
    result = tmp_path / "source/seed0/result.json"
    before = json.loads(result.read_text())
    edited("nas_data.policies.evaluate", "returns += np.where", "returns += 1.0 * np.where")
    compare(study, tmp_path, report=lambda _: None)
    after = json.loads(result.read_text())
    assert after["question"]["code"] != before["question"]["code"]
    assert (tmp_path / "source/seed0/policy.safetensors").stat().st_mtime_ns == weights


def test_the_commit_is_that_of_a_checkout_and_of_nothing_else(monkeypatch, tmp_path):
    environment_info.find_commit.cache_clear()
    said = environment_info.find_commit()
    assert said is None or len(said.removesuffix(environment_info.CHANGED)) == 40
    monkeypatch.setattr(environment_info, "ROOT", tmp_path)
    environment_info.find_commit.cache_clear()
    assert environment_info.find_commit() is None
    environment_info.find_commit.cache_clear()
    assert {"python", "onnxruntime", "torch", "nas_data"} <= set(environment_info.read_versions())
