"""The paper's experiments at a tiny size: each makes its files, is done once, goes on, and says what is wrong."""

import json
import re
import shutil
from dataclasses import replace

import numpy as np
import pytest
from support.command_samples import nas
from support.experiment_samples import TINY, times, tiny
from support.report_samples import gap_report

from nas_data import registry
from nas_data.dataset.provenance import read_provenance
from nas_data.dataset.read import read
from nas_data.dataset.verify import verify
from nas_data.effects.base import parse
from nas_data.envs.loop.dynamics_spec import DynamicsSpec
from nas_data.errors import OptionError, OutputExists, UnknownName
from nas_data.gap.side_by_side import is_sharing_cores
from nas_data.gap.write_model import write_effects
from nas_data.studies.experiments import figure6
from nas_data.studies.experiments.base import FOLDER, Experiment, find_experiment
from nas_data.studies.experiments.figure6 import find_sufficient_count
from nas_data.studies.experiments.pipeline import authors, sample_size, stages
from nas_data.studies.experiments.pipeline.artifacts import METHODS, Artifacts, MaterialPlan, list_needed_stages
from nas_data.studies.experiments.pipeline.run import format_stem, list_experiment_jobs, run_experiment
from nas_data.studies.experiments.pipeline.sizes import FULL, QUICK, RECORDINGS
from nas_data.studies.experiments.table1 import PREDICTORS, compute_differences, compute_statistics

CHEAP = ("expert", "source", "nas", "randomised")  # without `nas gap`, which takes minutes
RESTS_ON = ("coulomb_friction (torque 1 N·m)", "serve all seeds", "[range of 2 seeds]", "in 50% of cases")
PART = "figure5-Pusher-backlash-tiny-methods-expert-source-nas-randomised"


def text_of(folder, stem):
    return (folder / f"{stem}.md").read_text(encoding="utf-8")


def json_of(folder, stem):
    return json.loads((folder / f"{stem}.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder in which tiny experiments on Pusher were made."""
    place = tmp_path_factory.mktemp("experiments")
    run_experiment("figure5", tiny(place, "Pusher", methods=CHEAP))
    run_experiment("figure4", tiny(place, "Pusher"))
    run_experiment("table1", tiny(place, "Pusher"))
    return place


def named_by(*effects, episodes=(TINY.named,), verdict="partly_explained"):
    """Stands for `nas gap`, which takes minutes: it names these effects, and says this of what they leave."""

    def investigate(dataset, model, out, say):
        assert read(dataset).n_episodes in episodes
        assert model.is_file()
        say("name: which effect is missing")
        out.mkdir(parents=True, exist_ok=True)
        write_effects(out, [parse(text) for text in effects], {})
        return gap_report(verdict=verdict if effects else "none")

    return investigate


# --- figure 5


def test_figure5_compares_the_methods_in_json_table_and_picture(folder):
    found = json_of(folder, PART)
    methods = found["environments"]["Pusher"]["methods"]
    assert list(methods) == list(CHEAP)
    page = text_of(folder, PART)
    for method, values in methods.items():
        assert len(values["returns"]) == len(TINY.seeds)
        assert f"| {method} | {METHODS[method].learned_on} | 2 | {np.median(values['returns']):.2f} [" in page
    assert (folder / f"{PART}.png").read_bytes().startswith(b"\x89PNG")
    assert "-67.84 | -67.85 |" in page  # the authors' expert, median and mean


def test_the_table_says_what_it_rests_on(folder):
    page, pusher = text_of(folder, PART), json_of(folder, PART)["environments"]["Pusher"]
    assert all(sentence in page for sentence in RESTS_ON)
    assert pusher["intervals"]["nas"]["kind"] == "range of 2 seeds"
    assert pusher["at_stake"]["value"] == pytest.approx(
        pusher["methods"]["expert"]["return"]["median"] - pusher["methods"]["source"]["return"]["median"]
    )


def test_every_run_of_figure5_records_what_it_depends_on(folder):
    found = json_of(folder, PART)["environments"]["Pusher"]
    material = Artifacts(plan_of(folder), folder / "tiny/Pusher-backlash/material")
    for run in found["runs"]:
        record = json.loads((folder / "tiny/Pusher-backlash/policies/256" / run["result"]).read_text())
        assert record["question"]["training"]["seed"] == run["seed"]
        known = material.content_hash if METHODS[run["method"]].needs else None
        assert record["circumstances"]["dataset"] == known
        assert {"python", "onnxruntime", "mujoco", "torch", "nas_data"} <= set(record["circumstances"]["versions"])
        assert record["wall_seconds"] > 0
        assert record["cpu_seconds"] > 0
        assert run["judging"]["cpu_seconds"] > 0
    assert found["dataset"] == material.content_hash
    assert set(found["stages"]) >= {"record", "phi"}
    assert all(stage["cpu_seconds"] > 0 for stage in found["stages"].values())
    assert {run["method"] for run in found["runs"]} == set(CHEAP)


def plan_of(folder):
    request = tiny(folder, "Pusher")
    sizes = request.sizes
    return MaterialPlan(sizes.recipe("Pusher", "backlash"), sizes.heldout, sizes.delta, sizes.forward, sizes.named)


def test_less_than_the_experiment_says_so_wherever_it_is_shown(folder):
    for stem in (PART, "figure4-Pusher-backlash-tiny", "table1-Pusher-backlash-tiny"):
        assert "not a result" in text_of(folder, stem)
        assert "coulomb_friction (torque 1 N·m) in j1" in text_of(folder, stem)
        assert "seed 0" in text_of(folder, stem)
        assert json_of(folder, stem)["warning"]
    assert not FULL.sentence()


def test_the_recordings_are_whole_and_hold_the_objects(folder):
    material = Artifacts(plan_of(folder), folder / "tiny/Pusher-backlash/material")
    for path, episodes in ((material.train, TINY.trajectories), (material.heldout, TINY.heldout)):
        assert verify(path) == []
        dataset = read(path)
        assert dataset.paired
        assert dataset.n_episodes == episodes
        assert "observation.environment_state" in dataset.features
    commands = read(material.train).commands.reshape(TINY.trajectories, 100, 3)
    changes = (np.diff(commands, axis=1) != 0).any(axis=2).sum(axis=1)
    assert (changes[::4] == 99).all()  # the paper's protocol; in the others actions last longer
    assert (np.delete(changes, np.s_[::4]) < 99).any()


def test_a_second_call_trains_nothing_and_finds_the_same(folder):
    before = times(folder / "tiny")
    said: list[str] = []
    found = run_experiment("figure5", tiny(folder, "Pusher", said=said, methods=CHEAP))
    assert times(folder / "tiny") == before
    assert sum("done before" in line for line in said) == 2
    assert "all environments together" not in said
    assert found.data["environments"]["Pusher"]["methods"]["nas"]["returns"]
    assert all(sentence in found.text for sentence in RESTS_ON)


@pytest.mark.parametrize(
    ("name", "count"), [("figure4", 3), ("table1", 3), ("figure5", 2 + len(CHEAP) * len(TINY.seeds))]
)
def test_the_jobs_of_a_finished_experiment_are_listed_as_done(folder, name, count):
    request = tiny(folder, "Pusher", methods=CHEAP if name == "figure5" else ())
    before = times(folder)
    jobs = list_experiment_jobs(name, request)
    assert len(jobs) == len({job.name for job in jobs}) == count
    assert all(job.took is not None and job.took < 60 for job in jobs)
    assert any(job.took is None for job in list_experiment_jobs("figure5", replace(request, dynamics="paper")))
    assert times(folder) == before


def test_policies_of_other_code_are_refused_before_a_run_too(folder, tmp_path):
    shutil.copytree(folder / "tiny", tmp_path / "tiny")
    request = replace(tiny(folder, "Pusher", methods=("source",)), folder=tmp_path)
    assert all(job.took is not None for job in list_experiment_jobs("figure5", request))
    for file in ("config.json", "result.json"):
        path = tmp_path / "tiny/Pusher-backlash/policies/256/source/seed0" / file
        path.write_text(re.sub(r'"code": "\w+"', '"code": "0"', path.read_text()))
    for answer in (list_experiment_jobs, run_experiment):
        with pytest.raises(OutputExists, match="trained by another version"):
            answer("figure5", request)


def test_more_seeds_leave_those_done_before_alone(folder):
    place = folder / "tiny/Pusher-backlash"
    before = times(place)
    run_experiment("figure5", tiny(folder, "Pusher", methods=("expert", "source"), seeds=(0, 1, 2)))
    assert {path: time for path, time in times(place).items() if path in before} == before
    assert (place / "policies/256/source/seed2/result.json").is_file()


def test_the_experiments_share_recordings_and_models(folder):
    notes = sorted(path.stem for path in (folder / "tiny/Pusher-backlash/material/stages").glob("*.json"))
    assert notes == ["phi", "psi", "record"]


# --- names, which stand in for `nas gap`


@pytest.mark.bullet
@pytest.mark.slow
def test_the_target_may_be_computed_by_another_engine(tmp_path):
    request = tiny(tmp_path, "ErgoReacher", dynamics="source", engine="bullet", methods=("source", "nas"), seeds=(0,))
    found = run_experiment("figure5", request)
    assert format_stem("figure5", request).startswith("figure5-ErgoReacher-source-bullet-")
    assert "'source' in PyBullet" in found.text
    assert "The target is computed by PyBullet, the source by MuJoCo." in found.text
    material = request.material("ErgoReacher", ("record",))
    provenance = read_provenance(material.heldout)
    assert provenance.target["engine"] == "bullet"
    assert provenance.source["engine"] == "mujoco"
    assert found.data["engine"] == "bullet"
    target = found.data["environments"]["ErgoReacher"]["target"]
    assert target["simulator"]["engine"] == "bullet"


@pytest.mark.parametrize(
    "effects", [("coulomb_friction:joint=j1,torque=0.8",), pytest.param((), marks=pytest.mark.slow)]
)
def test_named_methods_learn_in_what_was_named(tmp_path, monkeypatch, effects):
    monkeypatch.setattr(stages.workflow, "investigate", named_by(*effects))
    found = run_experiment("figure5", tiny(tmp_path, "Pusher", methods=("source", "named", "named_nas"), seeds=(0,)))
    place = tmp_path / "tiny/Pusher-backlash/policies/256"
    results = {run["method"]: place / run["result"] for run in found.data["environments"]["Pusher"]["runs"]}
    plants = {
        method: json.loads(result.read_text())["question"]["training"]["plant"] for method, result in results.items()
    }
    assert list(results) == ["named", "named_nas", "source"]
    for method in ("named", "named_nas"):
        assert len(plants[method]["simulator"]["effects"]) == len(effects)
    assert plants["named_nas"]["model"]["kind"] == "delta"
    same = found.data["environments"]["Pusher"]["methods"]
    assert (same["named"]["returns"] == same["source"]["returns"]) == (not effects)  # nothing named is the source
    assert ("named trains in the same environment as source: they share their policies." in found.text) == (not effects)
    assert "has nothing to learn" not in found.text


@pytest.mark.parametrize("verdict", ["explained", pytest.param("retuned", marks=pytest.mark.slow)])
def test_where_the_names_explain_all_phi_is_left_out_and_no_policy_trained_twice(tmp_path, monkeypatch, verdict):
    effect = "coulomb_friction:joint=j1,torque=0.8"
    named = named_by(effect, episodes=(TINY.named, 2), verdict=verdict)
    monkeypatch.setattr(stages.workflow, "investigate", named)
    request = tiny(tmp_path, "Pusher", methods=("named", "nas", "named_nas"), seeds=(0,))
    found = run_experiment("figure5", request)
    place = tmp_path / "tiny/Pusher-backlash"
    assert "has nothing to learn there" in json.loads((place / "material/stages/phi_named.json").read_text())["said"][0]
    assert not list((place / "material/phi_named").iterdir())
    methods = found.data["environments"]["Pusher"]["methods"]
    assert methods["named_nas"]["returns"] == methods["named"]["returns"] != methods["nas"]["returns"]
    assert sorted(path.name for path in (place / "policies/256").iterdir()) == ["named", "nas"]
    assert "named_nas trains in the same environment as named" in found.text
    assert "named_nas is the source with the names" in found.text
    before = times(tmp_path)
    assert run_experiment("figure5", request).data["environments"]["Pusher"]["methods"] == methods
    assert {path: when for path, when in times(tmp_path).items() if "/tiny/" in str(path)} == {
        path: when for path, when in before.items() if "/tiny/" in str(path)
    }
    sweep = run_experiment("figure6", tiny(tmp_path, "Pusher", seeds=(0,), counts=(2,), methods=("named", "named_nas")))
    assert sweep.data["methods"]["named_nas"]["returns"] == sweep.data["methods"]["named"]["returns"]


@pytest.mark.slow
def test_nas_gap_itself_names_in_the_pipeline(tmp_path):
    run_experiment("figure5", tiny(tmp_path, "Pusher", methods=("named", "named_nas"), seeds=(0,)))
    note = json.loads((tmp_path / "tiny/Pusher-backlash/material/stages/names.json").read_text())
    assert note["data"]["verdict"]


# --- figure 4 and table 1


def test_figure4_tells_the_errors_of_one_sequence_it_did_not_learn_from(folder):
    found = json_of(folder, "figure4-Pusher-backlash-tiny")["environments"]["Pusher"]
    dataset = read(Artifacts(plan_of(folder), folder / "tiny/Pusher-backlash/material").heldout)
    rows = dataset.episode(found["episode"])
    assert set(found["stages"]) == {"record", "phi", "psi"}
    assert found["episode"] % 4 == 0  # the paper's protocol
    np.testing.assert_allclose(found["positions"]["measured"], dataset.next_states[rows, :3], atol=1e-6)
    start = dataset.states[rows.start, :3]
    np.testing.assert_allclose(found["positions"]["hold"], np.tile(start, (100, 1)), atol=1e-6)
    rms = np.sqrt(np.square(np.subtract(found["positions"]["source"], found["positions"]["measured"])).mean(axis=1))
    np.testing.assert_allclose(found["rms_error_rad"]["source"], rms, atol=1e-6)
    for end in ("", "-growth"):
        assert (folder / f"figure4-Pusher-backlash-tiny{end}.png").read_bytes().startswith(b"\x89PNG")


def test_table1_has_quartiles_of_every_predictor(folder):
    found = json_of(folder, "table1-Pusher-backlash-tiny")["environments"]["Pusher"]
    for episodes in ("paper_protocol", "all_heldout"):
        assert list(found[episodes]) == list(PREDICTORS)
        for values in found[episodes].values():
            assert 0 <= values["first_quartile"] <= values["median"] <= values["third_quartile"]


class Predicted:
    """Errors of two episodes and two joints, in which one diverged."""

    class evaluation:  # noqa: N801
        class squared:  # noqa: N801
            squared = (np.pi / 2) ** 2 * np.array([[1.0, 2.0], [3.0, np.nan]])

        open_loop = {"source": squared}  # noqa: RUF012


def test_differences_are_in_units_of_right_angles_and_what_diverged_counts_as_infinite():
    np.testing.assert_allclose(compute_differences(Predicted, "source", [0, 1]), [1, 2, 3, np.inf])
    assert compute_statistics(Predicted, "source", [0, 1])["third_quartile"] == pytest.approx(3.0)
    assert compute_statistics(Predicted, "source", [0])["mean"] == pytest.approx(1.5)


# --- figure 6 and 8


@pytest.mark.slow
def test_figure6_sweeps_nested_subsets_and_says_how_many_are_enough(tmp_path):
    request = tiny(tmp_path, "Pusher", seeds=(0,))
    found = run_experiment("figure6", request)
    assert np.shape(found.data["methods"]["nas"]["returns"]) == (len(TINY.counts), 1)
    assert "source + φ: smallest number of trajectories" in found.text
    assert {(run["count"], run["seed"]) for run in found.data["runs"]} == {(count, 0) for count in TINY.counts}
    assert all(run["learning_seconds"] > 0 and run["cpu_seconds"] > 0 for run in found.data["runs"])
    jobs = list_experiment_jobs("figure6", request)
    assert len(jobs) == 1 + 2 + len(TINY.counts) and all(job.took for job in jobs)
    before = times(tmp_path / "tiny")
    again = run_experiment("figure6", request)
    assert times(tmp_path / "tiny") == before
    assert again.data["methods"] == found.data["methods"]
    assert again.data["runs"] == found.data["runs"]


@pytest.mark.slow
def test_counts_added_to_figure6_are_subsets_of_the_same_recording(tmp_path):
    few = run_experiment("figure6", tiny(tmp_path, "Pusher", seeds=(0,), counts=(2,)))
    learned = tmp_path / "tiny/Pusher-backlash" / f"counts{max(TINY.counts)}/sweep/2/seed0"
    before = times(learned)
    more = run_experiment("figure6", tiny(tmp_path, "Pusher", seeds=(0,), counts=(2, 3)))
    assert more.data["dataset"] == few.data["dataset"]
    assert times(learned) == before
    assert more.data["methods"]["nas"]["returns"][0] == few.data["methods"]["nas"]["returns"][0]
    beyond = run_experiment("figure6", tiny(tmp_path, "Pusher", seeds=(0,), counts=(max(TINY.counts) + 1,)))
    assert beyond.data["dataset"] != few.data["dataset"]  # more than the whole experiment has needs a larger one


@pytest.mark.slow
def test_figure6_names_from_each_subset_and_learns_on_the_names(tmp_path, monkeypatch):
    asked, alone, jobs = [], [], []

    def investigate(dataset, *arguments):
        asked.append(read(dataset).n_episodes)
        alone.append(not is_sharing_cores())
        return named_by("backlash:joint=j1,half_width=0.1", episodes=TINY.counts)(dataset, *arguments)

    monkeypatch.setattr(sample_size.workflow, "investigate", investigate)
    monkeypatch.setattr(figure6, "do_count", lambda job: jobs.append(job) or sample_size.do_count(job))
    request = tiny(tmp_path, "Pusher", seeds=(0,), methods=("named_nas", "forward", "named", "nas"))
    found = run_experiment("figure6", request)
    assert asked == list(TINY.counts)  # once a count, for both methods
    methods = found.data["methods"]
    assert list(methods) == ["named_nas", "forward", "named", "nas"]
    assert len({str(values["returns"]) for values in methods.values()}) == 4
    stem = "figure6-Pusher-backlash-tiny-methods-forward-nas-named-named_nas-seeds-0"
    assert "| source + named effects | 4 | 1 |" in text_of(tmp_path, stem)
    sweep = tmp_path / "tiny/Pusher-backlash" / f"counts{TINY.trajectories}/sweep/2/seed0"
    made_of = {
        "named": (True, None),
        "named_nas": (True, "delta"),
        "forward": (False, "forward"),
        "nas": (False, "delta"),
    }
    for method, (names, kind) in made_of.items():
        plant = json.loads((sweep / method / "256/result.json").read_text())["question"]["training"]["plant"]
        assert bool(plant["simulator"]["effects"]) == names
        assert (plant["model"] or {}).get("kind") == kind
    before = times(tmp_path / "tiny")
    assert run_experiment("figure6", request).data["methods"] == methods
    assert times(tmp_path / "tiny") == before
    (sweep / "names.json").write_text("{}")  # as if other code had named
    assert run_experiment("figure6", replace(request, methods=("named",))).data["methods"]["named"] == methods["named"]
    assert asked == [*TINY.counts, 2]
    (sweep / "names.json").write_text("{}")
    sample_size.name_subset(replace(jobs[0], threads=1))  # as beside another worker
    assert alone == [True, True, True, False]


def test_figure6_trains_phi_for_few_trajectories_beside_that_for_many(tmp_path):
    presets, methods = {**TINY.presets, "few": replace(TINY.delta, hidden=4)}, ("nas_few", "nas", "nas_symmetric")
    request = tiny(tmp_path, "Pusher", seeds=(1,), counts=(2,), presets=presets, methods=methods)
    found = run_experiment("figure6", request)
    sweep = tmp_path / "tiny/Pusher-backlash" / f"counts{max(TINY.counts)}/sweep/2/seed1"
    names = ("phi_few", "phi", "phi_symmetric")
    options = {name: json.loads((sweep / f"{name}.json").read_text())["options"] for name in names}
    assert [options[name]["hidden"] for name in names] == [4, 8, 8]
    assert [options[name]["corrects"] for name in names] == ["state", "state", "command"]
    assert [options[name]["seed"] for name in names] == [1, 1, 1]
    assert len({json.loads((sweep / f"{name}.json").read_text())["learned_from"] for name in names}) == 1
    assert len({str(found.data["methods"][method]["returns"]) for method in methods}) == 3
    assert "source + φ, preset few: median return" in found.text  # one number of trajectories says nothing of enough
    assert "smallest number" not in found.text and found.data["methods"]["nas_few"]["enough"] is None
    assert (tmp_path / "figure6-Pusher-backlash-tiny-methods-nas-nas_few-nas_symmetric-seeds-1-counts-2.json").is_file()
    with pytest.raises(UnknownName, match="forward, named, named_nas, nas, nas_few, nas_symmetric"):
        run_experiment("figure6", replace(request, methods=("expert",)))


@pytest.mark.slow
def test_figure6_where_nothing_is_named_has_the_source(tmp_path, monkeypatch):
    monkeypatch.setattr(sample_size.workflow, "investigate", named_by(episodes=TINY.counts))
    found = run_experiment(
        "figure6", tiny(tmp_path, "Pusher", seeds=(0,), counts=(2,), methods=("named", "named_nas", "nas"))
    )
    methods = found.data["methods"]
    assert methods["named"]["returns"][0] == found.data["ends"]["methods"]["source"]["returns"]
    assert methods["named_nas"]["returns"] == methods["nas"]["returns"]


def test_figure6_refuses_methods_that_learn_from_no_recording(tmp_path):
    with pytest.raises(UnknownName, match=r"expert.*forward, named, named_nas, nas"):
        run_experiment("figure6", tiny(tmp_path, "Pusher", methods=("nas", "expert")))


@pytest.mark.parametrize("environment", ["ErgoReacher", "Striker"])
def test_figure6_refuses_a_preset_of_other_arms_before_any_work(tmp_path, environment):
    request = tiny(tmp_path, environment, methods=("nas", "nas_symmetric"))
    for act in (run_experiment, list_experiment_jobs):
        with pytest.raises(
            OptionError, match=rf"nas_symmetric cannot be trained on {environment}: .* That is the method nas_few"
        ):
            act("figure6", request)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("medians", "enough"),
    [((-100, -68, -67), 25), ((-100, -90, -67), 50), ((10, 10, 10), 10), ((9.4, 9.6, 10.0), 25), ((-1, -2, -3), 10)],
)
def test_enough_is_within_five_per_cent_of_the_best(medians, enough):
    assert find_sufficient_count((10, 25, 50), np.array(medians, dtype=float)[:, None]) == enough


@pytest.mark.slow
def test_figure8_counts_hits_and_draws_a_response(tmp_path):
    request = tiny(tmp_path, "ErgoShield", seeds=(0,), methods=("source", "nas"))
    shield = run_experiment("figure8", request).data["environments"]["ErgoShield"]
    assert set(shield["methods"]) == {"source", "nas"}
    assert shield["authors"]["nas"]["values"] == [20.17, 11.95]
    assert np.shape(shield["response"]["positions"]["source + φ"]) == (300, 6)
    assert (tmp_path / f"{format_stem('figure8', request)}-response.png").is_file()


@pytest.mark.slow
def test_figure8_compares_all_methods_and_says_which_else_there_are(tmp_path):
    found = run_experiment("figure8", tiny(tmp_path, "ErgoShield", seeds=(0,)))
    shield = found.data["environments"]["ErgoShield"]
    assert set(shield["methods"]) == {"expert", "source", "forward", "nas", "randomised"}
    assert "--methods includes it" in found.text
    assert shield["authors"]["nas"]["values"] == [20.17, 11.95]
    assert np.shape(shield["response"]["positions"]["source + φ"]) == (300, 6)
    assert (tmp_path / "figure8-ErgoShield-backlash-tiny-seeds-0-response.png").is_file()


# --- the commands


@pytest.mark.parametrize(
    ("name", "end", "options"),
    [
        ("figure4", "", ()),
        pytest.param(
            "figure5",
            "-methods-expert-source-seeds-0",
            ("--methods", "expert", "source", "--seeds", "0"),
            marks=pytest.mark.slow,
        ),
        pytest.param(
            "figure6",
            "-seeds-0-counts-2-frames-128",
            ("--counts", "2", "--seeds", "0", "--frames", "128"),
            marks=pytest.mark.slow,
        ),
        pytest.param("table1", "", ("--env", "Pusher"), marks=pytest.mark.slow),
    ],
)
def test_each_command_makes_its_experiment(tmp_path, monkeypatch, name, end, options):
    monkeypatch.setattr("nas_data.studies.experiments.pipeline.sizes.QUICK", TINY)
    answer = nas("experiment", name, "--quick", "--out", tmp_path, "--json", *options)
    assert answer.code == 0, answer.err
    assert answer.json["experiment"] == name
    assert answer.json["size"] == "tiny"
    written = json_of(tmp_path, f"{name}-Pusher-backlash-tiny{end}")
    assert {key: answer.json[key] for key in written} == written
    assert "Pusher, dynamics 'backlash' →" in answer.err


# --- going on


class Cut(Exception):
    """Stands for a power cut."""


def test_an_experiment_goes_on_where_it_was_cut(tmp_path, monkeypatch):
    def cut(*_):
        raise Cut

    with monkeypatch.context() as patch:
        patch.setattr(stages, "run_training", cut)
        with pytest.raises(Cut):
            run_experiment("figure4", tiny(tmp_path, "Pusher"))
    place = tmp_path / "tiny/Pusher-backlash/material"
    before = times(place / "datasets")
    run_experiment("figure4", tiny(tmp_path, "Pusher"))
    assert times(place / "datasets") == before


def test_material_of_other_sizes_is_left_alone(folder):
    before = times(folder / "tiny")
    with pytest.raises(OutputExists, match="differs in heldout"):
        run_experiment("figure4", tiny(folder, "Pusher", heldout=5))
    assert times(folder / "tiny") == before


@pytest.mark.slow
def test_what_one_model_lost_is_made_again_and_the_other_kept(folder, tmp_path):
    run_experiment("figure4", tiny(tmp_path, "ErgoReacher"))
    place = tmp_path / "tiny/ErgoReacher-backlash/material"
    before = times(place / "psi")
    (place / "stages/phi.json").unlink()
    run_experiment("figure4", tiny(tmp_path, "ErgoReacher"))
    assert times(place / "psi") == before
    assert (place / "stages/phi.json").is_file()


# --- the registry, names and numbers


@pytest.mark.parametrize("name", registry.list_names(FOLDER))
def test_every_file_of_the_folder_is_an_experiment_with_a_command(name):
    experiment = find_experiment(name)
    assert isinstance(experiment, Experiment)
    assert experiment.title
    for environment in experiment.environments:
        assert "backlash" in DynamicsSpec(environment).task.dynamics
    assert f"experiment_{name}" in registry.list_names("commands")


def test_other_environments_have_other_files(tmp_path):
    three = find_experiment("figure5").environments
    names = [format_stem("figure5", tiny(tmp_path, *chosen)) for chosen in (three, three[:2], three[:1], three[::-1])]
    assert names[0] == "figure5-backlash-tiny"
    assert names[1] == "figure5-Pusher-Striker-backlash-tiny"
    assert len(set(names)) == 4


def test_the_experiments_of_the_paper_are_there():
    assert set(registry.list_names(FOLDER)) >= {"figure4", "figure5", "figure6", "figure8", "table1"}


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--env", "Pusher", "--methods", "nass"), r"no method 'nass'; choose one of: expert, forward"),
        (("--env", "Pushr"), r"no environment 'Pushr'; choose one of: ErgoReacher"),
        (("--env", "ErgoShield", "--dynamics", "papr"), r"no dynamics 'papr'; choose one of: backlash"),
        (("--env", "Pusher", "Pusher"), r"none twice"),
        (("--env", "Pusher", "nas/Pusher-v0"), r"none twice"),
        (("--workers", "0"), r"--workers is 0; it must be 1 or more"),
        (("--seeds", "1", "1"), r"different numbers"),
        (("--frames", "0"), r"--frames is 0; it must be 1 or more"),
    ],
)
def test_what_is_wrong_is_said_before_anything_is_written(tmp_path, options, said):
    answer = nas("experiment", "figure5", "--out", tmp_path / "out", *options)
    assert answer.code == 2
    assert re.search(said, answer.err)
    assert len(answer.err.splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_unknown_experiments_and_methods_list_the_choices(tmp_path):
    with pytest.raises(UnknownName, match="figure4, figure5"):
        run_experiment("figure9", tiny(tmp_path, "Pusher"))
    with pytest.raises(OptionError, match="at least 2 trajectories"):
        run_experiment("figure6", tiny(tmp_path, "Pusher", counts=(1, 4)))
    with pytest.raises(OptionError, match="one environment"):
        run_experiment("figure6", tiny(tmp_path, "Pusher", "ErgoReacher"))


def test_what_is_named_twice_is_done_once(tmp_path):
    request = tiny(tmp_path, "Pusher", methods=("source", "source", "expert"))
    listed = [job.name for job in list_experiment_jobs("figure5", request)]
    assert len(listed) == len(set(listed)) == 2 * len(TINY.seeds)
    requests = (tiny(tmp_path, "Pusher", counts=counts) for counts in ((3, 2, 3), (2, 3), (4, 2)))
    stems = [format_stem("figure6", request) for request in requests]
    whole = "figure6-Pusher-backlash-tiny"
    assert stems == [f"{whole}-counts-2-3", f"{whole}-counts-2-3", whole]


def test_methods_take_only_the_material_that_they_need():
    assert list_needed_stages(("expert", "source", "randomised")) == set()
    assert list_needed_stages(("nas",)) == {"phi"}
    assert set(METHODS) == {"expert", "source", "forward", "nas", "named", "named_nas", "randomised"}


def test_the_target_of_a_dynamics_with_a_source_of_its_own_is_set_against_that():
    plan = MaterialPlan(FULL.recipe("ErgoReacher", "paper"), 1, FULL.delta, FULL.forward)
    assert plan.source == "paper-source"
    assert MaterialPlan(FULL.recipe("Pusher", "paper"), 1, FULL.delta, FULL.forward).source == "source"


def test_the_full_experiment_is_the_papers():
    assert (FULL.frames, len(FULL.seeds), FULL.judged) == (2_000_000, 5, 100)
    assert {name: one.trajectories for name, one in RECORDINGS.items()} == {
        "pusher": 1000,  # of the authors' published returns; the paper's text says 250
        "ergo_reacher": 1000,
        "striker": 5000,
        "ergo_shield": 2000,  # the paper says 500, which φ learns by heart
    }
    assert FULL.phi("nas/Pusher-v0") == FULL.delta
    assert FULL.phi("Striker").updates == 0  # along a chaotic arm no gradient of the source leads far
    assert QUICK.phi("Striker") == QUICK.delta
    assert QUICK.frames < FULL.frames / 10
    assert (min(FULL.counts), max(FULL.counts)) == (10, 2000)


def test_the_authors_numbers_have_sources_and_their_published_means():
    means = {method: round(numbers.mean, 2) for method, numbers in authors.RETURNS["pusher"].items()}
    assert means == {"expert": -67.85, "source": -122.65, "forward": -94.44, "nas": -67.28}
    for group in (*authors.RETURNS.values(), authors.DIFFERENCES):
        for numbers in group.values():
            assert numbers.source.startswith(("aalitaiga/sim-to-real", "paper"))
    assert set(authors.RETURNS) <= set(RECORDINGS)
