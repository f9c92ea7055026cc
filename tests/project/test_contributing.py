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


CONTRACTS = (
    "tests/effects/test_effects.py",
    "tests/robots/test_robots.py",
    "tests/envs/test_envs.py",
    "tests/excitations/test_excitations.py",
    "tests/envs/test_tasks.py",
)
PLUG_INS = "cable_pull or flag or pulses"
RECORDED = ("record", "sim", "--robot", "flag", "--effect", "cable_pull:joint=hoist,stiffness=0.05")
ALL = f"""
import sys
import pytest
from nas_data.cli import main
assert main({[*RECORDED, "--excitation", "pulses", "--episodes", "2", "--out", "flag"]}) == 0
assert main(["verify", "flag"]) == 0
sys.exit(pytest.main(["-vv", *{list(CONTRACTS)}, "-k", "{PLUG_INS}"]))
"""


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
    sizes = root / "tests/support/typical_effects.py"
    assert sizes.read_text().count("TYPICAL = {") == 1
    typical = 'TYPICAL = {\n    ("cable_pull", "stiffness"): 0.05,'
    sizes.write_text(sizes.read_text().replace("TYPICAL = {", typical))
    return root


def run(root: Path, *command: str) -> str:
    environment = {**os.environ, "PYTHONPATH": str(root)}
    done = subprocess.run([sys.executable, *command], cwd=root, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def told(extended) -> str:
    """What one process says that records with the plug-ins, verifies that, and runs the contracts of their folders."""
    return run(extended, "-c", ALL)


@pytest.mark.parametrize(
    ("contract", "plug_in", "fewest"),
    [
        (CONTRACTS[0], "cable_pull", 4),
        (CONTRACTS[1], "flag", 2),
        (CONTRACTS[2], "raise_flag", 2),
        (CONTRACTS[3], "pulses", 4),
        (CONTRACTS[4], "raise_flag", 2),
    ],
)
def test_a_plug_in_passes_the_contract_of_its_folder(told, contract, plug_in, fewest):
    passed = [line for line in told.splitlines() if line.startswith(contract) and "PASSED" in line]
    assert len([line for line in passed if plug_in in line]) >= fewest


def test_the_plug_ins_are_found_by_their_names(told):
    assert "Recorded 2 episodes of flag" in told


def test_the_plug_ins_satisfy_the_linters(extended):
    files = [str(extended / name) for name in dict(BLOCK.findall((ROOT / "CONTRIBUTING.md").read_text()))]
    pythons = [name for name in files if name.endswith(".py")]
    run(extended, "-m", "ruff", "check", *pythons)
    run(extended, "-m", "ruff", "format", "--check", *pythons)
