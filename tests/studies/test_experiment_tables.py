"""What experiments write: after each environment, apart from their parts, and with what must be said below."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.experiment_samples import tiny
from support.policy_samples import scored

from nas_data.envs.base import find_task
from nas_data.envs.loop.dynamics_spec import DynamicsSpec
from nas_data.envs.pusher import TORQUE
from nas_data.errors import JobsFailed, OptionError, UnknownName
from nas_data.policies.compare import Comparison, Study
from nas_data.policies.intervals import compute_median_interval, compute_return_range
from nas_data.policies.policy import DivergedEpisodes
from nas_data.recorders.recipe import CommandKind, Recipe
from nas_data.reports.figures import draw_error_growth, quartiles
from nas_data.runs.parallel import Workers
from nas_data.studies.experiments import figure6
from nas_data.studies.experiments.pipeline import compare_methods, run, stages
from nas_data.studies.experiments.pipeline.artifacts import METHODS, Artifacts, MaterialPlan
from nas_data.studies.experiments.pipeline.authors import RETURNS, list_remarks
from nas_data.studies.experiments.pipeline.compare_methods import make_hyperparameters
from nas_data.studies.experiments.pipeline.run import format_stem, run_experiment
from nas_data.studies.experiments.pipeline.sizes import FULL, PPO
from nas_data.studies.experiments.pipeline.table_notes import (
    describe_dynamics,
    describe_intervals,
    describe_paired,
    describe_return_differences,
)

ENDS = ("expert", "source")


def comparison(**returns):
    """A comparison of methods with given returns of each seed."""
    seeds = range(len(next(iter(returns.values()))))
    results = {(method, seed): scored(values[seed]) for method, values in returns.items() for seed in seeds}
    return Comparison(
        Study(DynamicsSpec("Pusher"), dict.fromkeys(returns, DynamicsSpec("Pusher")), tuple(seeds)), None, results
    )


# --- files


def test_each_environment_is_written_when_it_is_done_and_a_failure_leaves_the_others_alone(tmp_path, monkeypatch):
    request = tiny(tmp_path, "Pusher", "ErgoReacher", methods=ENDS, seeds=(0,))
    original = run.make

    def failing(name, experiment, asked):
        if asked.environments[-1] == "ErgoReacher":
            assert (tmp_path / f"{format_stem(name, tiny_of(asked, 'Pusher'))}.json").is_file()
            raise OptionError("no reacher today")
        return original(name, experiment, asked)

    monkeypatch.setattr(run, "make", failing)
    with pytest.raises(OptionError, match="no reacher today"):
        run_experiment("figure5", request)
    monkeypatch.setattr(run, "make", original)
    found = run_experiment("figure5", request)
    assert set(found.data["environments"]) == {"Pusher", "ErgoReacher"}
    written = {path.name for path in tmp_path.glob("*.json")}
    end = "backlash-tiny-methods-expert-source-seeds-0.json"
    assert written == {f"figure5-{names}-{end}" for names in ("Pusher", "ErgoReacher", "Pusher-ErgoReacher")}


def tiny_of(request, *environments):
    return type(request)(**{**vars(request), "environments": environments})


@pytest.mark.parametrize(
    ("changes", "end"),
    [
        ({}, ""),
        ({"methods": tuple(METHODS)}, ""),
        ({"methods": ("source", "expert")}, "-methods-expert-source"),
        ({"seeds": (0,)}, "-seeds-0"),
        ({"frames": 64}, "-frames-64"),
        ({"counts": (2,)}, "-counts-2"),
        ({"ppo": "authors"}, "-ppo-authors"),
        ({"seeds": (3, 4), "frames": 64, "methods": ("nas",)}, "-methods-nas-seeds-3-4-frames-64"),
    ],
)
def test_a_part_of_an_experiment_has_other_files_than_the_whole(tmp_path, changes, end):
    assert format_stem("figure5", tiny(tmp_path, "Pusher", **changes)) == f"figure5-Pusher-backlash-tiny{end}"


# --- the order of work


def test_methods_that_need_no_material_are_done_before_any_is_made(tmp_path, monkeypatch):
    done = []

    def note(text):
        done.append(text)
        raise Stop

    class Stop(Exception):
        pass

    monkeypatch.setattr(stages, "record_and_pair", lambda *_: note("recorded"))
    said: list[str] = []
    with pytest.raises(Stop):
        run_experiment("figure5", tiny(tmp_path, "Pusher", said=said, methods=("nas", *ENDS), seeds=(0,)))
    assert len(list(tmp_path.rglob("result.json"))) == len(ENDS)
    assert any("2 of 2" in line for line in said)


def test_without_a_method_that_needs_material_none_is_made(tmp_path):
    found = run_experiment("figure5", tiny(tmp_path, "Pusher", methods=ENDS, seeds=(0,)))
    assert not (tmp_path / "tiny/Pusher-backlash/material/datasets").exists()
    assert found.data["environments"]["Pusher"]["dataset"] is None


def test_a_method_without_the_ends_is_told_what_they_would_tell(tmp_path):
    alone = run_experiment("figure5", tiny(tmp_path, "Pusher", methods=("randomised",), seeds=(0,)))
    assert "both expert and source among --methods" in alone.text
    beside = run_experiment("figure5", tiny(tmp_path, "Pusher", methods=("randomised", *ENDS), seeds=(0,)))
    assert "both expert and source among --methods" not in beside.text
    ends = run_experiment("figure5", tiny(tmp_path, "Pusher", methods=ENDS[:1], seeds=(0,)))
    assert "both expert and source among --methods" not in ends.text


def test_the_authors_numbers_are_said_to_be_of_what_they_are_of():
    assert list_remarks(["Striker"]) == []  # never published in numbers
    (simulated,) = list_remarks(["Pusher", "Striker", "ErgoReacher"])
    (real,) = list_remarks(["ErgoShield"])
    assert "'paper'" in simulated
    assert "real arm" in real and "'paper'" in real


def test_workers_of_figure6_simulate_on_one_thread(tmp_path, monkeypatch):
    class Seen(Exception):
        pass

    def look(function, jobs, workers, locks):
        assert {job.threads for job in jobs} == {1 if workers.count > 1 else None}
        raise Seen

    monkeypatch.setattr(figure6, "run_jobs", look)
    monkeypatch.setattr(figure6, "run_study", lambda *_: None)
    for workers in (1, 2):
        with pytest.raises(Seen):
            run_experiment("figure6", tiny(tmp_path, "Pusher", seeds=(0,), workers=Workers(workers)))


# --- what is recorded


def test_actions_are_brief_long_weak_or_smooth_but_for_the_paper_s_protocol():
    recipe = replace(FULL.recipe("Pusher", "backlash"), episodes=400)
    kinds, actions = recipe.kinds(), np.array(recipe.session().commands) / TORQUE
    assert set(kinds[::4]) == {CommandKind(1)}
    others = [kind for number, kind in enumerate(kinds) if number % 4]
    assert {kind.smooth for kind in others} == {True, False}
    for drawn, low, high in (("every", 2, 50), ("strength", 0.2, 1.0)):
        found = np.array([getattr(kind, drawn) for kind in others])
        assert low <= found.min() < 1.2 * low and 0.9 * high < found.max() <= high
        assert abs(np.median(found) - (10 if drawn == "every" else 0.6)) < (2 if drawn == "every" else 0.05)
    strengths = np.array([kind.strength for kind in kinds])
    assert np.all(np.abs(actions).max(axis=(1, 2)) <= strengths + 1e-6)
    for kind, rows in zip(kinds, actions, strict=True):
        changes = np.abs(np.diff(rows, axis=0)).max(axis=1)
        assert (np.count_nonzero(changes) == (100 - 1) // kind.every) or kind.smooth
        assert not kind.smooth or changes.max() <= 2 * kind.strength / kind.every + 1e-6
    plan = MaterialPlan(recipe, 100, FULL.delta, FULL.forward)
    assert Artifacts(plan, Path()).paper_protocol() == list(range(0, 100, 4))


def test_more_episodes_of_a_recipe_begin_with_the_fewer():
    few, many = (replace(FULL.recipe("ErgoShield", "backlash"), episodes=count) for count in (5, 9))
    assert many.kinds()[:5] == few.kinds() != replace(few, seed=1).kinds()
    np.testing.assert_array_equal(many.session().commands[:5], few.session().commands)


def test_a_recipe_that_is_not_varied_holds_its_actions_in_turn():
    recipe = Recipe(environment="Pusher", dynamics="source", episodes=5, steps=20, holds=(1, 5))
    assert recipe.kinds() == [CommandKind(1), CommandKind(5), CommandKind(1), CommandKind(5), CommandKind(1)]


# --- PPO as the authors ran it


def test_the_authors_ppo_is_one_process_of_2048_steps_in_minibatches_of_64():
    theirs, ours = make_hyperparameters(FULL.with_ppo("authors")), make_hyperparameters(FULL)
    assert (theirs.arms, theirs.rollout, theirs.rollout // theirs.minibatches, theirs.epochs) == (1, 2048, 64, 10)
    assert (ours.arms, ours.rollout) == (16, 8192)
    assert FULL.with_ppo("authors").policies != FULL.policies == "2000000"
    with pytest.raises(UnknownName, match="authors, ours"):
        FULL.with_ppo("hers")


def test_both_kinds_of_ppo_lie_side_by_side_and_say_which_they_are(tmp_path, monkeypatch):
    monkeypatch.setitem(PPO, "authors", {"arms": 1, "rollout": 64, "minibatches": 4, "epochs": 1})
    for ppo in PPO:
        request = tiny(tmp_path, "Pusher", methods=("source",), seeds=(0,))
        run_experiment("figure5", type(request)(**{**vars(request), "sizes": request.sizes.with_ppo(ppo)}))
    stem = "figure5-Pusher-backlash-tiny-methods-source-seeds-0"
    found = {ppo: json.loads((tmp_path / f"{stem}{end}.json").read_text()) for ppo, end in named_ends()}
    for ppo, arms in (("ours", 16), ("authors", 1)):
        assert found[ppo]["ppo"] == ppo
        place = found[ppo]["environments"]["Pusher"]["policies"]
        config = json.loads((tmp_path / place / "source/seed0/config.json").read_text())
        assert config["hyperparameters"]["arms"] == arms


def named_ends():
    return (("ours", ""), ("authors", "-ppo-authors"))


# --- what stands below


@pytest.mark.parametrize(
    ("environment", "dynamics", "words"),
    [
        ("pusher", "backlash", ("backlash (half_width 0.15 rad) in j1", "coulomb_friction (torque 1 N·m) in j1")),
        ("pusher", "paper", ("pull_joint (joint=", "width=")),
        ("pusher", "source", ("nothing added",)),
        ("ergo_reacher", "backlash", ("speed_limit",)),
        ("ergo_shield", "backlash", ("in m1, m2, m3, m4, m5, m6; speed_limit",)),
        ("ergo_shield", "bigger-gap", ("widen_gap (joint=m1)",)),
        ("striker", "paper", ("joint=pan", "joint=wrist_flex")),
    ],
)
def test_what_a_dynamics_adds_is_said_from_its_own_definition(environment, dynamics, words):
    said = describe_dynamics(find_task(environment), dynamics)
    for word in words:
        assert word in said
    for effect in find_task(environment).effects(dynamics):
        assert effect.name() in said and effect.joint in said


@pytest.mark.parametrize("seeds", [2, 3, 4, 5])
def test_the_interval_of_few_seeds_is_their_range_and_holds_the_median_as_often_as_it_says(seeds):
    rng = np.random.default_rng(0)
    draws = rng.normal(0, 1, (20_000, seeds))
    held = (draws.min(axis=1) < 0) & (draws.max(axis=1) > 0)
    found = compute_median_interval(draws[0])
    assert (found.low, found.high) == (draws[0].min(), draws[0].max())
    assert held.mean() == pytest.approx(found.level, abs=0.01)
    assert "95" not in found.kind
    assert f"{found.level:.0%}" in describe_intervals(seeds)


def test_the_interval_of_more_seeds_is_a_bootstrap_within_their_range():
    found = compute_median_interval(np.arange(20.0))
    assert 0 < found.low < 9.5 < found.high < 19
    assert found.kind == "bootstrap, 95%"
    assert describe_intervals(20) == ""


def test_named_and_phi_is_compared_with_phi_alone_seed_by_seed():
    found = comparison(nas=[-70.0, -60.0, -80.0], named_nas=[-69.0, -58.0, -83.0])
    assert describe_paired(found) == {"differences": [1.0, 2.0, -3.0], "median": 1.0, "min": -3.0, "max": 2.0}
    assert describe_return_differences(found) == (
        "named_nas − nas, seed by seed: median +1.00, -3.00 … +2.00 over 3 seeds.",
    )
    assert describe_paired(comparison(nas=[1.0])) is None


def test_episodes_that_left_all_bounds_are_told_by_method():
    found = comparison(nas=[-70.0, -60.0], source=[-70.0, -60.0])
    assert found.describe_diverged() == []
    found.results["nas", 1] = replace(found.results["nas", 1], diverged=DivergedEpisodes(1200, 3))
    (sentence,) = found.describe_diverged()
    assert sentence.startswith("nas: 1,200 episodes in training and 3 in evaluation diverged")
    assert found.describe()["methods"]["nas"]["diverged"] == {"learning": [0, 1200], "judging": [0, 3]}
    assert sentence in found.table()


def test_where_source_and_expert_overlap_nothing_is_at_stake():
    apart = compute_return_range(np.array([-122.0, -120.0, -130.0]), np.array([-67.0, -70.0, -66.0]))
    assert apart.shown and apart.sentence() is None
    alike = compute_return_range(np.array([-70.0, -66.0, -68.0]), np.array([-67.0, -69.0, -66.5]))
    assert not alike.shown and "share of the distance that a method closes is undefined" in alike.sentence()
    assert not compute_return_range(np.array([1.0]), np.array([1.0])).shown
    found = comparison(source=[-70.0, -66.0, -68.0], expert=[-67.0, -69.0, -66.5])
    assert found.describe()["at_stake"]["shown"] is False
    assert alike.sentence() in found.table()


def test_the_authors_medians_and_means_stand_beside_ours_of_the_same_kind():
    found = comparison(expert=[-70.0, -60.0, -50.0])
    cells = dict(zip(compare_methods.make_headers(3), compare_methods.make_row(found, "Pusher", "expert"), strict=True))
    assert (cells["authors: median"], cells["authors: mean"]) == ("-67.84", "-67.85")
    assert cells["mean"] == "-60.00"
    described = RETURNS["ergo_reacher"]["source"].describe()
    assert described["median"] == -0.74 and described["mean"] == pytest.approx(-2.03, abs=0.01)


# --- figure 4


def test_a_rollout_that_diverged_counts_as_infinitely_wrong_and_a_short_one_not_at_all():
    found = quartiles([np.array([1.0, 1.0, np.nan]), np.array([2.0, np.inf, np.nan]), np.array([3.0, 3.0, np.nan])])
    np.testing.assert_array_equal(found[:, 0], [1.5, 2, 2.5])
    np.testing.assert_array_equal(found[:, 1], [2, 3, np.inf])
    assert np.isinf(found[:, 2]).all()
    np.testing.assert_array_equal(quartiles([np.array([1.0, 2.0]), np.array([5.0])])[:, 1], [2, 2, 2])


def test_a_curve_of_diverged_rollouts_is_drawn():
    figure = draw_error_growth(
        {"source": [np.array([0.1, np.nan]), np.array([0.2, np.nan])], "hold": [np.array([0.1, 0.3])]}, 0.1
    )
    (axes,) = figure.axes
    assert np.isfinite(axes.get_ylim()).all()


def test_the_failures_of_several_environments_are_one_sentence(tmp_path, monkeypatch):
    def failing(name, experiment, asked):
        raise OptionError(f"no {asked.environments[0]} today")

    monkeypatch.setattr(run, "make", failing)
    with pytest.raises(JobsFailed, match=r"2 of 2 jobs failed.*no Pusher today no ErgoReacher today"):
        run_experiment("figure5", tiny(tmp_path, "Pusher", "ErgoReacher"))
