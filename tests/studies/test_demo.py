"""The demo: every stage works, is done once, and its page says what its files say."""

import json
import os
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.command_samples import Answer, nas

from nas_data.dataset.provenance import read_provenance
from nas_data.dataset.read import read
from nas_data.dataset.verify import verify
from nas_data.effects.base import parse
from nas_data.errors import OutputExists
from nas_data.gap.report import GapReport
from nas_data.gap.write_model import write_effects
from nas_data.runs.stages import Stage, StageResult, begin, read_done, run_stages
from nas_data.studies.demo import plan, recording
from nas_data.studies.demo.plan import FULL, STAGES, Demo
from nas_data.studies.demo.recording import DATASETS, FOLDER, HELDOUT, TRAIN, find_newest

SMALLER = {"episodes": 6, "frames": 256, "rollout": 256, "minibatches": 2, "epochs": 1, "judged": 2}
WHOLE = plan.QUICK
QUICK = replace(WHOLE, **SMALLER)
NAMES = [stage.name for stage in STAGES]
ROW = r"<tr><th>([\w ]+ in [\w ]+)</th>(.*?)</tr>"  # of the table of what hides and what was named


def number(value: float, unit: str, width: float) -> dict:
    """A parameter as a gap report lists it."""
    return {"value": value, "unit": unit, "interval95": [value - width, value + width]}


def found(effect: str, joint: str | None, confidence: float, **parameters: dict) -> dict:
    """A finding as a gap report lists it."""
    errors = {"heldout_error_before": 0.2, "heldout_error_after": 0.01, "unit": "rad"}
    kept = {"parameters": parameters, "confidence": confidence, "evidence": errors}
    return {"effect": effect, "joint": joint, **kept, "alternatives": [], "in_model_xml": True}


REPORT = {
    "verdict": "partly_explained",
    "effects": [
        found("backlash", "m3", 0.96, half_width=number(np.radians(6.7), "rad", np.radians(0.05))),
        found("command_delay", None, 0.51, delay=number(0.007, "s", 0.001)),
    ],
    "retuned": [],
    "unexplained": [],
    "gap": {"unit": "rad", "noise_floor": 0.001, "before": 0.2, "plain": 0.1, "after": 0.01},
    "find": {"joints": {}, "regimes": [], "audit": []},
    "next_experiment": None,
    "episodes": {"train": [0], "heldout": [1]},
    "seed": 0,
    "seconds": 1.0,
}


def leave_report(folder: Path) -> None:
    """Put a gap report where the search would, which takes minutes."""
    folder.mkdir(parents=True)
    write_effects(folder, [parse("backlash:joint=m3,half_width=0.117"), parse("command_delay:delay=0.007")], {})
    (folder / "report.json").write_text(json.dumps(REPORT))
    shape, joints = (1, 20, 6), QUICK.task.joints
    moved = {name: np.full(shape, error) for name, error in (("before", 0.2), ("retuned", 0.1), ("after", 0.01))}
    still = {"measured": np.zeros(shape), "command": np.zeros(shape), "counts": np.ones(shape[:2], bool)}
    time, floor = np.arange(1, 21) / 100, np.full(6, 0.001)
    np.savez(folder / "series.npz", time=time, joints=joints, episodes=[1], floor=floor, **moved, **still)


@pytest.fixture(scope="module", autouse=True)
def _small():
    """Let the quick demo be smaller still."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(plan, "QUICK", QUICK)
        yield


def run_demo(folder: Path, size: plan.DemoPlan) -> Answer:
    """Run the quick demo in a folder."""
    begin([], Demo(size, folder, print))
    leave_report(folder / FOLDER)
    answer = nas("demo", "--quick", "--out", folder)
    assert answer.code == 0, answer.err
    return answer


@pytest.fixture(scope="module")
def demo(tmp_path_factory, _small) -> tuple[Path, Answer]:
    """The folder of a quick demo, and what the program said."""
    folder = tmp_path_factory.mktemp("somewhere") / "demo"
    return folder, run_demo(folder, QUICK)


@pytest.mark.slow
def test_the_quick_demo_does_every_stage_at_its_own_size(tmp_path, monkeypatch):
    monkeypatch.setattr(plan, "QUICK", WHOLE)
    answer = run_demo(tmp_path / "demo", WHOLE)
    assert len(re.findall(r"^      took \d+ s$", answer.err, re.MULTILINE)) == len(STAGES)
    assert (tmp_path / "demo/report.html").is_file()


def times(folder: Path) -> dict[Path, int]:
    """When each file was last written."""
    return {path: path.stat().st_mtime_ns for path in folder.rglob("*") if path.is_file()}


# --- what the quick demo leaves


def test_every_stage_says_what_it_does_and_how_long_it_took(demo):
    _, answer = demo
    for number, stage in enumerate(STAGES, start=1):
        assert f"[{number}/{len(STAGES)}] {stage.title}\n" in answer.err
    assert len(re.findall(r"^      took \d+ s$", answer.err, re.MULTILINE)) == len(STAGES)
    assert max(len(line) for line in answer.out.splitlines()) < 200


def test_the_datasets_are_whole_and_name_target_and_source(demo):
    folder, _ = demo
    for name, episodes in ((TRAIN, QUICK.episodes), (HELDOUT, QUICK.heldout)):
        path = find_newest(Demo(QUICK, folder, print), name)
        assert verify(path) == []
        dataset = read(path)
        assert dataset.paired
        assert dataset.n_episodes == episodes
        provenance = read_provenance(path)
        effects = {effect["effect"] for effect in provenance.target["effects"]}
        assert effects == {"backlash", "speed_limit"}
        assert provenance.source["effects"] == []
        assert (path / "meta/source.xml").is_file()


def test_the_recording_is_the_targets_motion_to_the_sensors_resolution(demo):
    folder, _ = demo
    dataset = read(find_newest(Demo(QUICK, folder, print), HELDOUT))
    shape = (dataset.n_episodes, int(dataset.lengths[0]), -1)
    columns = (dataset.states, dataset.commands, dataset.next_states)
    states, commands, after = (column.reshape(shape).astype(float) for column in columns)
    quantum = np.radians(300 / 1023)
    apart = {
        name: np.abs(QUICK.task.simulator(name).rollout(states[:, 0], commands) - after)[..., :6]
        for name in ("source", QUICK.dynamics)
    }
    assert np.median(apart[QUICK.dynamics]) < quantum  # it starts at a rounded reading, half a quantum off at most
    assert apart["source"].max() > 10 * quantum


def test_joints_that_the_task_does_not_act_on_are_commanded_to_stay(demo):
    folder, _ = demo
    commands = read(find_newest(Demo(QUICK, folder, print), TRAIN)).commands
    assert not commands[:, [0, 3]].any()
    assert (commands[:, [1, 2, 4, 5]].std(axis=0) > 0.3).all()


def test_the_page_says_what_the_files_say(demo):
    folder, _ = demo
    page = (folder / "report.html").read_text(encoding="utf-8")
    errors = json.loads((folder / "models/errors.json").read_text())["open_loop"]
    for row in errors.values():
        assert f"<td>{np.degrees(row['all']):.2f}</td>" in page
    assert list(errors) == ["source + φ", "ψ", "source + names", "source", "hold", "command"]
    for method in ("expert", "source", "augmented", "forward", "named"):
        record = json.loads((folder / f"policies/{method}/seed0/result.json").read_text())
        assert f"<td>{record['score']['return']:.2f}</td>" in page
    for name in (TRAIN, HELDOUT):
        assert read_provenance(find_newest(Demo(QUICK, folder, print), name)).content_hash in page
    drawn = re.findall(r'class="chart" id="(.*?)"', page)
    models = ["errors_of_hinges", "trajectory", "error_growth"]
    assert drawn == [*models, "returns_on_target", "learning_curves", "success", "model_training"]


def test_the_page_sets_what_was_named_beside_what_hides(demo):
    folder, _ = demo
    page = (folder / "report.html").read_text(encoding="utf-8")
    rows = {name: re.findall(r"<td>(.*?)</td>", cells) for name, cells in re.findall(ROW, page)}
    assert rows["backlash in m3"] == ["6.88°", "6.70°", "6.65 … 6.75°", "96 % (sure)"]
    assert rows["speed limit in m2"] == ["286°/s", "–", "–", "–"]
    assert rows["command delay in the whole arm"] == ["–", "7.00 ms", "6.00 … 8.00 ms", "51 % (a guess)"]
    assert len(rows) == len(QUICK.task.effects(QUICK.dynamics)) + 1


def test_the_search_is_given_episodes_that_do_not_say_what_hides_and_its_names_are_told(demo, tmp_path, monkeypatch):
    """The search itself is replaced: it takes minutes."""
    folder, _ = demo
    given: list[Path] = []

    def search(dataset: Path, model: Path, out: Path, say) -> GapReport:
        given.append(dataset)
        say("  tried: " + 50 * "one thing, ")
        leave_report(out)
        return GapReport.load(out)

    lines: list[str] = []
    shutil.copytree(folder / DATASETS, tmp_path / DATASETS)
    monkeypatch.setattr(recording, "investigate", search)
    told = recording.name_effects(Demo(replace(QUICK, named=3), tmp_path, lines.append))
    assert read(given[0]).n_episodes == 3
    assert not any(effect in (given[0] / "meta/nas.json").read_text() for effect in ("backlash", "speed_limit"))
    assert told.summary[0] == "nas gap names: backlash in m3 and command delay (whole arm)"
    assert "11.46° → 0.57° (plain fit 5.73°, noise floor 0.06°)" in told.summary[1]
    assert [len(line) < 120 for line in lines] == [True]


def test_errors_on_the_page_are_those_of_nas_evaluate(demo):
    folder, _ = demo
    answer = nas("evaluate", folder / "models/phi", folder / "datasets" / HELDOUT, "--json")
    assert answer.code == 0, answer.err
    errors = json.loads((folder / "models/errors.json").read_text())["open_loop"]
    for name in ("source + φ", "source", "hold", "command"):
        assert answer.json["open_loop"][name]["overall"] == pytest.approx(errors[name]["all"], rel=1e-9)


# --- a second run


def test_a_second_run_changes_nothing_and_says_so(demo):
    folder, _ = demo
    before = times(folder)
    answer = nas("demo", "--quick", "--out", folder, "--json")
    assert answer.code == 0
    assert answer.err.count("done before") == len(STAGES)
    assert times(folder) == before
    assert list(answer.json) == NAMES


def test_a_second_run_loads_no_network_library(demo):
    folder, _ = demo
    code = (
        "import sys; from dataclasses import replace; from nas_data.cli import main; "
        f"from nas_data.studies.demo import plan; plan.QUICK = replace(plan.QUICK, **{SMALLER}); "
        f"assert main(['demo', '--quick', '--out', {str(folder)!r}]) == 0; "
        "assert not {'torch', 'stable_baselines3', 'matplotlib', 'lerobot'} & set(sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=dict(os.environ))
    assert done.returncode == 0, done.stderr


def test_a_lost_page_is_written_again_from_what_is_there(demo):
    folder, _ = demo
    page = folder / "report.html"
    rows = re.findall(r"<td>-?[\d.]+</td>", page.read_text(encoding="utf-8"))
    page.unlink()
    answer = nas("demo", "--quick", "--out", folder)
    assert answer.code == 0
    assert answer.err.count("done before") == len(STAGES) - 1
    assert re.findall(r"<td>-?[\d.]+</td>", page.read_text(encoding="utf-8")) == rows


def test_a_demo_of_other_sizes_is_left_alone(demo):
    folder, _ = demo
    before = times(folder)
    answer = nas("demo", "--out", folder)
    assert answer.code == 2
    assert "differs in episodes" in answer.err
    assert times(folder) == before


# --- stages, without the work


def staged(log: list[str], *names: str) -> tuple[Stage, ...]:
    """Stages that write a file and a line into a log."""

    def work(name):
        def do(demo: Demo) -> StageResult:
            log.append(name)
            (demo.folder / name).write_text(name)
            return StageResult([f"{name} said"], {"name": name}, [f"{name} in short"])

        return do

    return tuple(Stage(name, name, "does something", work(name), (name,)) for name in names)


@pytest.fixture
def empty(tmp_path) -> Demo:
    return Demo(QUICK, tmp_path / "demo", lambda _: None)


def test_stages_are_done_once_and_in_order(empty):
    log: list[str] = []
    stages = staged(log, "a", "b", "c")
    first = run_stages(stages, empty)
    second = run_stages(stages, empty)
    assert log == ["a", "b", "c"]
    assert {name: done.data for name, done in first.items()} == {name: done.data for name, done in second.items()}
    assert [list(done.summary) for done in second.values()] == [["a in short"], ["b in short"], ["c in short"]]


@pytest.mark.parametrize(("lost", "again"), [("a", "abc"), ("b", "bc"), ("c", "c")])
def test_what_was_lost_is_done_again_with_all_that_follows(empty, lost, again):
    log: list[str] = []
    stages = staged(log, "a", "b", "c")
    run_stages(stages, empty)
    (empty.folder / lost).unlink()
    log.clear()
    run_stages(stages, empty)
    assert log == list(again)


def test_a_stage_is_done_again_only_with_what_it_builds_on(empty):
    log: list[str] = []
    a, b, c, d = staged(log, "a", "b", "c", "d")
    stages = (a, replace(b, builds_on=("a",)), replace(c, builds_on=("a",)), replace(d, builds_on=("b",)))
    run_stages(stages, empty)
    (empty.folder / "b").unlink()
    log.clear()
    run_stages(stages, empty)
    assert log == ["b", "d"]


def test_an_interrupted_stage_counts_as_not_done(empty):
    log: list[str] = []
    a, b = staged(log, "a", "b")

    def cut(demo: Demo) -> StageResult:
        (demo.folder / "b").write_text("half")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_stages((a, replace(b, work=cut)), empty)
    assert read_done(b, empty.folder) is None
    run_stages((a, b), empty)
    assert log == ["a", "b"]


def test_a_damaged_note_of_a_stage_is_no_note(empty):
    log: list[str] = []
    stages = staged(log, "a")
    run_stages(stages, empty)
    (empty.folder / "stages/a.json").write_text('{"seconds": 1')
    run_stages(stages, empty)
    assert log == ["a", "a"]


@pytest.mark.parametrize("what", ["a file", "other files", "another plan", "a damaged plan"])
def test_a_folder_of_something_else_is_refused_and_kept(empty, what):
    folder = empty.folder
    if what == "a file":
        folder.write_text("mine")
    else:
        folder.mkdir()
        (folder / ("mine.txt" if what == "other files" else "plan.json")).write_text("{" if "damaged" in what else "{}")
    before = times(folder.parent)
    log: list[str] = []
    with pytest.raises(OutputExists, match="choose another --out"):
        run_stages(staged(log, "a"), empty)
    assert not log
    assert times(folder.parent) == before


def test_the_full_demo_is_what_the_readme_promises():
    assert FULL.episodes == 200
    assert FULL.heldout >= 20
    assert (FULL.seconds, FULL.task.period) == (3.0, 0.01)
    assert 1.0 in FULL.holds  # the paper's protocol
    effects = [effect.name() for effect in FULL.task.effects(FULL.dynamics)]
    assert effects.count("backlash") == 2
    assert "speed_limit" in effects
    assert 3 * len(FULL.holds) <= FULL.named, "nas gap needs episodes of every kind to fit and to judge by"


def test_a_plan_says_all_that_tells_it_from_another():
    described = json.dumps(QUICK.describe())
    assert json.loads(described)["effects"]["backlash"]
    for change in ({"seeds": (1,)}, {"holds": (0.3,)}, {"delta": replace(QUICK.delta, hidden=9)}, {"judged": 5}):
        assert json.dumps(replace(QUICK, **change).describe()) != described
