"""The hash of our own code: what decides a result changes it, what is said about it does not."""

import json

import pytest

from nas_data import circumstances, code_hash
from nas_data.envs.loop.plant import Plant
from nas_data.errors import OutputExists
from nas_data.policies.compare import Study, compare
from nas_data.policies.learner import Hyperparameters, Training
from nas_data.policies.policy import CONFIG

SMALL = Hyperparameters(arms=2, rollout=32, minibatches=2, epochs=1)


def training(environment, dynamics="source"):
    return Training(Plant(environment, dynamics), 0, 32, SMALL)


@pytest.mark.parametrize(
    ("module", "old", "new"),
    [
        ("nas_data.envs.pusher", "EFFORT_COST, REACH_COST = 0.1, 0.5", "EFFORT_COST, REACH_COST = 0.1, 0.6"),  # reward
        ("nas_data.envs.pusher", "horizon=100", "horizon=101"),
        ("nas_data.envs.pusher", "START_ANGLE = 0.1", "START_ANGLE = 0.2"),
        ("nas_data.envs.loop.arena", "self.elapsed += 1", "self.elapsed += 2"),
        ("nas_data.effects.backlash", "half_width", "width"),
        ("nas_data.policies.learner", "gae_lambda=p.trace", "gae_lambda=1.0"),
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


def test_a_study_refuses_policies_of_other_code_and_leaves_them_alone(tmp_path, edited):
    study = Study(Plant("Pusher"), {"source": Plant("Pusher")}, (0,), 32, 2, SMALL)
    first = compare(study, tmp_path, report=lambda _: None)
    held = (tmp_path / "source/seed0" / CONFIG).read_bytes()
    edited("nas_data.envs.pusher", "REACHED = 0.17", "REACHED = 0.18")
    with pytest.raises(OutputExists, match="other code of nas_data"):
        compare(study, tmp_path, report=lambda _: None)
    assert (tmp_path / "source/seed0" / CONFIG).read_bytes() == held
    code_hash.studied.cache_clear()
    assert first.records["source", 0]["question"]["code"]


def test_other_code_that_judges_judges_a_kept_policy_again(tmp_path, edited):
    study = Study(Plant("Pusher"), {"source": Plant("Pusher")}, (0,), 32, 2, SMALL)
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
    circumstances.commit.cache_clear()
    said = circumstances.commit()
    assert said is None or len(said.removesuffix(circumstances.CHANGED)) == 40
    monkeypatch.setattr(circumstances, "ROOT", tmp_path)
    circumstances.commit.cache_clear()
    assert circumstances.commit() is None
    circumstances.commit.cache_clear()
    assert {"python", "onnxruntime", "torch", "nas_data"} <= set(circumstances.versions())
