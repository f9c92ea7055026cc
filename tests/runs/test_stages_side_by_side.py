"""Stages side by side: what builds on nothing unfinished is begun, and what fails takes only its followers along."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import load_file
from support.experiment_samples import tiny
from support.stage_samples import ALL, Plan, do_one, staged

from nas_data.errors import OutputExists, SimulationDiverged
from nas_data.runs.parallel import Workers
from nas_data.runs.stages import STAGES as NOTES
from nas_data.runs.stages import Part, Work, do_part, find_prerequisites, read_stage, run_side_by_side
from nas_data.studies.experiments.pipeline.artifacts import PHI, PSI


def go(folder: Path, plan: Plan, workers: int = 2) -> list[str]:
    said: list[str] = []
    run_side_by_side(tuple(ALL.values()), Work(plan, folder, said.append), Workers(workers), do_one)
    return said


def test_stages_run_beside_each_other_and_after_those_that_they_build_on(tmp_path, capfd):
    go(tmp_path / "work", Plan(meet=("left", "right")))
    found = {name: read_stage(name, tmp_path / "work").data for name in ALL}
    for name, stage in ALL.items():
        assert all(found[name]["began"] >= found[before]["ended"] for before in stage.builds_on)
    assert {(tmp_path / "work" / name).read_text() for name in ALL} == {"1"}, "one thread each"
    said = capfd.readouterr().err
    for name in ALL:
        assert all(line in said for line in (f"Stage {name}\n", f"{name} works", f"Stage {name}: took", "is done"))


def test_what_was_done_is_kept_and_what_was_lost_is_done_again_with_what_builds_on_it(tmp_path):
    folder = tmp_path / "work"
    go(folder, Plan())
    before = times(folder)
    assert [line.split(": done before")[0] for line in go(folder, Plan())] == [f"Stage {name}" for name in ALL]
    assert times(folder) == before
    (folder / "left").unlink()
    assert [line.split(":")[0] for line in go(folder, Plan())] == ["Stage root", "Stage right"]
    changed = {path.name for path, when in times(folder).items() if before[path] != when}
    assert changed == {"left", "on_left", "left.begun", "on_left.begun", "left.json", "on_left.json"}


def test_a_stage_that_another_process_did_by_other_code_is_refused(tmp_path):
    stage = replace(ALL["root"], code=lambda _: "ours")
    part = Part("root", Plan(), tmp_path, "work", None)
    do_part(stage, part)
    do_part(replace(stage, work=None), part)
    with pytest.raises(OutputExists, match=r"'Stage root' in .* was made by another version of nas_data"):
        do_part(replace(stage, code=lambda _: "theirs"), part)


def times(folder: Path) -> dict[Path, int]:
    return {path: path.stat().st_mtime_ns for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize(("fails", "left_out"), [("left", {"left", "on_left"}), ("root", set(ALL))])
def test_a_stage_that_fails_takes_only_those_along_that_build_on_it(tmp_path, fails, left_out):
    with pytest.raises(SimulationDiverged, match=f"{fails} cannot be done"):
        go(tmp_path / "work", Plan(fails=fails))
    assert {path.stem for path in (tmp_path / "work" / NOTES).glob("*.json")} == set(ALL) - left_out


def test_a_stage_that_says_nothing_of_it_builds_on_all_before_it():
    a, b, c = (replace(staged(name), builds_on=None) for name in "abc")
    assert find_prerequisites((a, b, c)) == {0: [], 1: [0], 2: [0, 1]}
    assert find_prerequisites((a, staged("b"), c)) == {0: [], 1: [], 2: [0, 1]}


@pytest.mark.slow
def test_the_material_of_an_environment_is_the_same_side_by_side(tmp_path):
    made = {
        workers: tiny(tmp_path / str(workers), "Pusher", workers=Workers(workers)).material("Pusher", (PHI, PSI))
        for workers in (1, 2)
    }
    one, two = made[1], made[2]
    assert one.content_hash == two.content_hash
    for folder in (PHI, PSI):
        weights = [load_file(material.folder / folder / "checkpoint/model.safetensors") for material in (one, two)]
        assert weights[0].keys() == weights[1].keys()
        assert all(np.array_equal(weights[0][name], weights[1][name]) for name in weights[0])
