"""The plug-ins that CONTRIBUTING.md shows work as they stand and pass the contracts of their folders."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
BLOCK = re.compile(r"<!-- file: (\S+) -->\n```\w+\n(.*?)```", re.DOTALL)


@pytest.fixture(scope="module")
def extended(tmp_path_factory) -> Path:
    """A copy of the package and its tests with the plug-ins of CONTRIBUTING.md."""
    root = tmp_path_factory.mktemp("extended")
    for name in ("nas_data", "tests"):
        shutil.copytree(ROOT / name, root / name, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", root)
    blocks = dict(BLOCK.findall((ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")))
    assert sorted(Path(name).parts[1] for name in blocks) == ["effects", "envs", "excitations", "robots"]  # one each
    for name, text in blocks.items():
        assert not (root / name).exists(), f"{name} exists already; the example needs another name"
        (root / name).write_text(text, encoding="utf-8")
    return root


def run(root: Path, *command: str) -> str:
    environment = {**os.environ, "PYTHONPATH": str(root)}
    done = subprocess.run([sys.executable, "-m", *command], cwd=root, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_the_effect_passes_the_contract_of_effects(extended):
    tests = extended / "tests" / "support" / "typical_effects.py"
    typical = 'TYPICAL = {\n    ("cable_pull", "stiffness"): 0.05,'
    assert tests.read_text().count("TYPICAL = {") == 1
    tests.write_text(tests.read_text().replace("TYPICAL = {", typical))
    assert re.search(r"[4-9] passed", run(extended, "pytest", "tests/effects/test_effects.py", "-k", "cable_pull"))


def test_the_robot_passes_the_contract_of_robots(extended):
    assert re.search(r"[2-9] passed", run(extended, "pytest", "tests/robots/test_robots.py", "-k", "flag"))


def test_the_excitation_passes_the_contract_of_excitations(extended):
    assert re.search(r"[4-9] passed", run(extended, "pytest", "tests/excitations/test_excitations.py", "-k", "pulses"))


def test_the_environment_passes_the_checkers(extended):
    assert re.search(r"[2-9] passed", run(extended, "pytest", "tests/envs/test_envs.py", "-k", "raise_flag"))


def test_the_plug_ins_are_found_by_their_names(extended):
    recorded = ("record", "sim", "--robot", "flag", "--effect", "cable_pull:joint=hoist,stiffness=0.05")
    run(extended, "nas_data", *recorded, "--excitation", "pulses", "--episodes", "2", "--out", "flag")
    run(extended, "nas_data", "verify", "flag")


def test_the_plug_ins_satisfy_the_linters(extended):
    files = [str(extended / name) for name in dict(BLOCK.findall((ROOT / "CONTRIBUTING.md").read_text()))]
    pythons = [name for name in files if name.endswith(".py")]
    run(extended, "ruff", "check", *pythons)
    run(extended, "ruff", "format", "--check", *pythons)
