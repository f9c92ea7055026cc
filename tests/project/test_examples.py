"""The scripts and the notebook in `examples/` run as they stand, and show what they say."""

import json
import os
import re
import runpy
import subprocess
import sys
from pathlib import Path

import pytest
from support.example_log import write_log
from support.notebooks import code_cells, run_notebook

import nas_data as nas

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"
SCRIPTS = sorted(path.stem for path in EXAMPLES.glob("*.py"))
NOTEBOOK = EXAMPLES / "paper.ipynb"
LONGEST = 60  # lines of a script


def run(folder: Path, name: str, *arguments: str) -> str:
    """Run an example in a folder of its own and return what it prints."""
    command = [sys.executable, str(EXAMPLES / f"{name}.py"), *arguments]
    environment = {"PYTHONPATH": str(ROOT), "MPLBACKEND": "Agg"}
    done = subprocess.run(command, cwd=folder, env={**os.environ, **environment}, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_an_effect_of_ones_own_is_found_again(tmp_path):
    said = run(tmp_path, "own_effect")
    assert float(re.search(r"with (\S+) N·m/rad", said)[1]) == pytest.approx(0.3, rel=0.03)
    assert 'stiffness="' in (tmp_path / "pendulum_with_cable.xml").read_text()


@pytest.mark.slow
def test_the_virtual_arm_is_recorded_and_its_play_shows(tmp_path):
    said = run(tmp_path, "ergojr_virtual")
    errors = {joint: float(error) for joint, error in re.findall(r"(m\d): open-loop error ([\d.]+)°", said)}
    assert max(errors, key=errors.get) == "m3"


@pytest.mark.slow
def test_a_hidden_effect_is_named(tmp_path):
    said = run(tmp_path, "name_hidden_effect")
    low, high = map(float, re.search(r"backlash in pendulum: half_width .* in \[(\S+), (\S+)\]", said).groups())
    assert low < 0.05 < high
    assert (tmp_path / "hidden_effect.png").stat().st_size > 1000


@pytest.mark.slow
def test_a_csv_log_becomes_a_report(tmp_path):
    said = run(tmp_path, "own_arm_from_csv")
    assert re.search(r"elbow: backlash half_width 0\.0[34]", said)
    assert (tmp_path / "runs/own_arm/model.xml").is_file()


def test_the_csv_log_is_what_its_script_writes(tmp_path):
    write_log(tmp_path / "log.csv")
    assert (tmp_path / "log.csv").read_text() == (EXAMPLES / "own_arm.csv").read_text()


@pytest.mark.slow
@pytest.mark.parametrize("given", [False, True])
def test_phi_corrects_a_so101_simulated_or_recorded(tmp_path, given):
    arguments = ()
    if given:
        effects = runpy.run_path(str(EXAMPLES / "so101.py"))["EFFECTS"]
        ramps = nas.record("so101_follower", effects=effects, excitation="ramps", rate=50, episodes=40, seconds=3)
        ramps.save(tmp_path / "mine")
        arguments = (str(tmp_path / "mine"),)
    said = run(tmp_path, "so101", *arguments)
    loop = said[said.index("Open loop") :]
    rows = re.findall(r"^ *(source \+ φ|source) +(.*)$", loop, re.M)
    errors = {name: float(values.split()[-2]) for name, values in rows}  # of all joints
    assert errors["source + φ"] < 0.8 * errors["source"]


def test_every_script_is_short_and_is_run_here():
    text = Path(__file__).read_text(encoding="utf-8")
    for name in SCRIPTS:
        assert len((EXAMPLES / f"{name}.py").read_text(encoding="utf-8").splitlines()) < LONGEST, name
        assert f'"{name}"' in text
    page = (ROOT / "docs/examples.md").read_text(encoding="utf-8")
    assert all(f"examples/{path.name}" in page for path in EXAMPLES.iterdir() if path.suffix in {".py", ".ipynb"})


@pytest.mark.slow
def test_the_notebook_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    left = run_notebook(json.loads(NOTEBOOK.read_text(encoding="utf-8")))
    errors = left["judged"].open_loop
    assert errors["source + φ"].overall < errors["source"].overall
    assert "backlash" in {effect.name for effect in left["report"].effects}


def test_the_notebook_holds_its_outputs_and_is_small():
    cells = code_cells(json.loads(NOTEBOOK.read_text(encoding="utf-8")))
    assert [cell["execution_count"] for cell in cells] == list(range(1, len(cells) + 1))
    kinds = {key for cell in cells for output in cell["outputs"] for key in output.get("data", {"stream": ""})}
    assert {"stream", "image/png"} <= kinds
    assert not any(output["output_type"] == "error" for cell in cells for output in cell["outputs"])
    assert NOTEBOOK.stat().st_size < 300_000  # bytes
