"""Policies on a source with what a gap report named: effects, hooks, retuned base, and the φ that belongs to it."""

import json
from dataclasses import replace
from pathlib import Path

import gymnasium
import mujoco
import numpy as np
import pytest
from support.env_samples import play, small_model

from nas_data import cli
from nas_data.effects.base import parse
from nas_data.envs.ergo_reacher import TASK
from nas_data.envs.loop.dynamics_spec import DynamicsSpec
from nas_data.errors import CheckpointError, JointMismatch, OptionError
from nas_data.gap.model_correction import ModelCorrection
from nas_data.gap.write_model import write_effects
from nas_data.policies.policy import read_config
from nas_data.reports.runs import find_runs
from nas_data.sources import collect_source_files

TRUE = TASK.dynamics["backlash"]
LIMIT, DRAG = "torque_limit:joint=m3,torque=0.3", "load_friction:joint=m3,ratio=0.3"


def report(folder, effects=TRUE, retuned=None):
    """Write a gap report's effects.json; return its folder."""
    folder.mkdir(parents=True, exist_ok=True)
    write_effects(folder, [parse(text) for text in effects], retuned or {})
    return str(folder)


def swing(simulator, steps=60):
    """Return the joints' path under fixed commands."""
    stepper = simulator.stepper(2)
    rng = np.random.default_rng(1)
    return np.array([stepper.step(np.repeat(rng.uniform(-1, 1, (1, 6)), 2, axis=0)) for _ in range(steps)])


def phi_of(folder, plant):
    """Return a φ that corrects nothing and keeps the source that it was trained on."""
    phi, source = small_model(folder, gain=0.0), plant.simulator()
    for name, content in collect_source_files(source.robot, source.effects).items():
        (folder / name).write_bytes(content)
    return phi


def test_a_source_with_the_true_effects_is_the_target(tmp_path):
    named = gymnasium.make("nas/ErgoReacher-v0", effects=report(tmp_path))
    target = gymnasium.make("nas/ErgoReacher-v0", dynamics="backlash")
    for env in (named, target):
        env.reset(seed=3)
    np.testing.assert_array_equal(play(named), play(target))


@pytest.mark.parametrize("place", ["folder", "file"])
def test_effects_are_found_in_a_reports_folder_and_by_their_file(tmp_path, place):
    folder = report(tmp_path)
    named = ModelCorrection.read(folder if place == "folder" else f"{folder}/effects.json")
    assert named.effects == tuple(map(parse, TRUE)) and not named.retuned


def test_a_report_itself_names_what_its_effects_file_does(tmp_path):
    file = Path(report(tmp_path, retuned={"m2.damping": 1.1})) / "effects.json"
    content = json.loads(file.read_text())
    listed = tmp_path / "report.json"
    listed.write_text(json.dumps({**content, "retuned": [{"parameter": "m2.damping", "factor": 1.1}]}))
    named, effects_file = ModelCorrection.read(listed), ModelCorrection.read(file)
    assert named.effects == effects_file.effects == tuple(map(parse, TRUE))
    assert named.retuned == effects_file.retuned == {"m2.damping": 1.1}


@pytest.mark.parametrize("retuned", [[1.1], [{"parameter": "m2.damping"}], "m2.damping", {"m2.damping": "more"}])
def test_factors_of_another_form_are_refused(tmp_path, retuned):
    file = tmp_path / "report.json"
    file.write_text(json.dumps({"effects": [], "retuned": retuned}))
    with pytest.raises(OptionError, match=r"'retuned' in .*report\.json must hold one factor per parameter"):
        ModelCorrection.read(file)


def test_an_effect_that_mjcf_cannot_express_acts_in_the_loop(tmp_path):
    plain, dragged = DynamicsSpec("ErgoReacher"), DynamicsSpec("ErgoReacher", effects=report(tmp_path, [DRAG]))
    assert np.abs(swing(plain.simulator()) - swing(dragged.simulator()))[..., :6].max() > 0.01


@pytest.mark.parametrize("parameter", ["m3.gain", "m2.mass", "m5.damping"])
def test_the_retuned_base_acts_in_the_loop_beside_the_effects(tmp_path, parameter):
    plants = [
        DynamicsSpec("ErgoReacher", effects=report(tmp_path / str(n), TRUE[:1], factors))
        for n, factors in enumerate(({}, {parameter: 1.2}))
    ]
    untuned, tuned = (plant.simulator() for plant in plants)
    assert np.abs(swing(untuned) - swing(tuned)).max() > 1e-3
    assert plants[0].describe() != plants[1].describe()


def test_a_retuned_gain_is_the_models_own_times_the_factor(tmp_path):
    plain, tuned = (
        DynamicsSpec("ErgoReacher", effects=effects).simulator().model
        for effects in (None, report(tmp_path, (), {"m3.gain": 1.1}))
    )
    servo = mujoco.mj_name2id(plain, mujoco.mjtObj.mjOBJ_ACTUATOR, plain.actuator("m3").name)
    gains = plain.actuator_gainprm[:, 0].copy()
    gains[servo] *= 1.1
    np.testing.assert_allclose(tuned.actuator_gainprm[:, 0], gains, rtol=1e-12)


def test_a_plants_description_follows_the_effects_and_not_their_folder(tmp_path):
    here, moved = (DynamicsSpec("ErgoReacher", effects=report(tmp_path / name)) for name in ("a", "b"))
    other = DynamicsSpec("ErgoReacher", effects=report(tmp_path / "c", TRUE[:-1]))
    assert here.describe() == moved.describe() != other.describe()
    assert json.loads(json.dumps(here.describe())) == here.describe(), "or a comparison would never go on"
    assert "retuned" not in DynamicsSpec("ErgoReacher").describe(), (
        "finished runs without effects are known by what they held"
    )


SOURCES = {"plain": (), "play": TRUE[:1], "true": TRUE, "limit": (LIMIT,), "friction": (DRAG,), "gain": ()}


@pytest.mark.parametrize(
    "own",
    [pytest.param(name, marks=pytest.mark.slow if name in {"play", "true", "limit"} else ()) for name in SOURCES],
)
def test_a_correction_is_used_on_its_own_source_only(tmp_path, own):
    plants = {"plain": DynamicsSpec("ErgoReacher")}
    for name, effects in SOURCES.items():
        if name != "plain":
            retuned = {"m3.gain": 1.05} if name == "gain" else {}
            plants[name] = DynamicsSpec("ErgoReacher", effects=report(tmp_path / name, effects, retuned))
    phi = phi_of(tmp_path / "phi", plants[own])
    for name, plant in plants.items():
        if name == own:
            replace(plant, checkpoint=phi).check()
            continue
        with pytest.raises(CheckpointError, match="another source than the one in use"):
            replace(plant, checkpoint=phi).check()


def test_a_correction_that_keeps_no_source_is_known_by_its_record(tmp_path):
    phi, effects = small_model(tmp_path / "phi"), report(tmp_path / "gap")
    with pytest.raises(CheckpointError, match="other effects"):
        DynamicsSpec("ErgoReacher", checkpoint=phi, effects=effects).check()
    config = tmp_path / "phi" / "config.json"
    content = json.loads(config.read_text())
    source = DynamicsSpec("ErgoReacher", effects=effects).simulator().describe()
    config.write_text(json.dumps({**content, "provenance": {"source": source}}))
    DynamicsSpec("ErgoReacher", checkpoint=phi, effects=effects).check()
    with pytest.raises(CheckpointError, match="other effects"):
        DynamicsSpec("ErgoReacher", checkpoint=phi).check()
    config.write_text(json.dumps({**content, "provenance": {"source": {**source, "sha256": "0"}}}))
    with pytest.raises(CheckpointError, match="another model"):
        DynamicsSpec("ErgoReacher", checkpoint=phi, effects=effects).check()


@pytest.mark.parametrize(
    ("content", "error", "sentence"),
    [
        ([{"effect": "backlash", "joint": "elbow", "parameters": {"half_width": 0.1}}], JointMismatch, "joint 'elbow'"),
        ({"effects": [], "retuned": {"elbow.mass": 1.1}}, JointMismatch, "parameter 'elbow.mass'"),
        ({"effects": [], "retuned": {"m3.gain": -1.0}}, OptionError, "factor must be a number above 0"),
        ({"effects": []}, OptionError, "names no effect"),
    ],
)
def test_effects_of_another_robot_or_of_nothing_are_refused(tmp_path, content, error, sentence):
    (tmp_path / "effects.json").write_text(json.dumps(content))
    with pytest.raises(error, match=sentence):
        DynamicsSpec("ErgoReacher", effects=str(tmp_path)).check()


@pytest.mark.usefixtures("small_ppo")
def test_the_commands_learn_in_the_named_source_and_compare_it(tmp_path, capsys):
    gap = report(tmp_path / "gap", TRUE, {"m3.gain": 1.05})
    out = tmp_path / "policy"
    words = ["policy", "train", "--on", "named", "--effects", gap, "--frames", "256", "--out", str(out)]
    assert cli.main(words) == 0
    assert cli.main(["policy", "evaluate", str(out), "--on", "named", "--effects", gap, "--episodes", "2"]) == 0
    plant = read_config(out / "seed0")["plant"]
    assert plant["retuned"] == {"m3.gain": 1.05} and len(plant["simulator"]["effects"]) == len(TRUE)
    (tmp_path / "gap" / "effects.json").write_text(json.dumps([parse(TRUE[0]).to_json()]))
    assert cli.main(words) == 2
    assert "holds another training (it differs in: plant)" in capsys.readouterr().err
    phi = phi_of(tmp_path / "phi", DynamicsSpec("ErgoReacher", effects=gap))
    options = ["--effects", gap, "--delta-named", phi, "--frames", "1", "--seed", "0", "--episodes", "2"]
    assert cli.main(["policy", "compare", *options, "--out", str(tmp_path / "compare")]) == 0
    methods = json.loads((tmp_path / "compare" / "comparison.json").read_text())["methods"]
    assert list(methods) == ["expert", "source", "named", "named_nas"]
    assert list(find_runs([tmp_path / "compare"]).groups()) == list(methods), "reports call them what comparisons do"


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["train", "--on", "named"], "needs --effects"),
        (["train", "--effects", "gap"], "'source' takes no --effects"),
        (["train", "--on", "target", "--effects", "gap"], "'target' takes no --effects"),
        (["train", "--on", "named", "--effects", "nowhere"], "no file nowhere"),
        (["train", "--on", "named", "--effects", "gap", "--checkpoint", "phi"], "'named' takes no --checkpoint"),
        (["evaluate", "x", "--on", "named"], "needs --effects"),
        (["evaluate", "x", "--effects", "gap"], "'target' takes no --effects"),
        (["compare", "--effects", "nowhere"], "no file nowhere"),
        (["compare", "--delta-named", "phi"], "--effects DIR"),
        (["compare", "--effects", "gap", "--delta-named", "phi"], "another source"),
        (["compare", "--delta", "psi", "--dry-run"], "a delta model is needed"),
        (["compare", "--forward", "phi", "--dry-run"], "a forward model is needed"),
        (["compare", "--effects", "gap", "--delta-named", "psi", "--dry-run"], "a delta model is needed"),
    ],
)
def test_bad_input_is_one_sentence_and_writes_nothing(tmp_path, monkeypatch, capsys, words, sentence):
    monkeypatch.chdir(tmp_path)
    report(tmp_path / "gap")
    phi_of(tmp_path / "phi", DynamicsSpec("ErgoReacher"))
    small_model(tmp_path / "psi", "forward")
    before = sorted(tmp_path.rglob("*"))
    assert cli.main(["policy", *words]) == 2
    error = capsys.readouterr().err
    assert sentence in error and "Traceback" not in error and error.count("\n") == 1
    assert sorted(tmp_path.rglob("*")) == before
