"""The project as a whole: what is shipped is complete and clean."""

import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
from packaging.requirements import Requirement

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
PYTHONS = {"311": "3.11", "312": "3.12"}

MACHINE_PATH = re.compile(r"/(?:work|tmp|root|farm|home|Users)/\w")


def own_files() -> list[Path]:
    """Return every file of the project as git sees it: tracked, or new and not ignored."""
    if not (ROOT / ".git").exists():
        pytest.skip("not a git checkout: which files are the project's is not known")
    listed = ["git", "ls-files", "--cached", "--others", "--exclude-standard", "-z"]
    names = subprocess.run(listed, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    return [path for name in names.split("\0") if name and (path := ROOT / name).is_file()]


def test_no_python_file_shadows_hugging_faces_datasets():
    assert list((ROOT / "datasets").rglob("*.py")) == []


def test_no_file_names_a_path_of_one_machine():
    found = []
    for path in own_files():
        try:
            lines = path.read_text(encoding="utf-8").splitlines()
        except UnicodeDecodeError:
            continue
        found += [
            f"{path.relative_to(ROOT)}:{n}: {line}" for n, line in enumerate(lines, 1) if MACHINE_PATH.search(line)
        ]
    assert found == []


def test_a_path_of_one_machine_would_be_found():
    assert MACHINE_PATH.search("open('" + "/".join(["", "home", "me", "data"]) + "')")
    assert not MACHINE_PATH.search("see https://example.org/a/b and runs/home")


def test_the_wheel_holds_every_file_of_the_package(tmp_path):
    source, wheels = tmp_path / "source", tmp_path / "wheels"
    for path in own_files():
        target = source / path.relative_to(ROOT)
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(path, target)
    build = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation", "--no-index"]
    subprocess.run([*build, "--wheel-dir", str(wheels), str(source)], check=True, capture_output=True)
    (wheel,) = wheels.glob("nas_data-*.whl")
    with zipfile.ZipFile(wheel) as archive:
        held = {name for name in archive.namelist() if ".dist-info" not in name}
        assert any(name.endswith("licenses/LICENSE") for name in archive.namelist())
    assert held == {path.relative_to(ROOT).as_posix() for path in own_files() if (ROOT / "nas_data") in path.parents}
    assert {".xml", ".toml", ".py"} <= {Path(name).suffix for name in held}


def pins(python: str) -> dict[str, str]:
    """Return the pinned version of each package, by its normalised name."""
    lines = (ROOT / "constraints" / f"py{python}.txt").read_text().splitlines()
    parsed = [line.partition("==") for line in lines if line and not line.startswith("#")]
    assert all(separator and re.fullmatch(r"[\w.+!-]+", version) for _, separator, version in parsed)
    return {re.sub(r"[-_.]+", "-", name).lower(): version for name, _, version in parsed}


@pytest.mark.parametrize("python", PYTHONS)
def test_every_dependency_is_pinned_to_a_version_that_the_project_allows(python):
    pinned = pins(python)
    optional = PROJECT["optional-dependencies"]
    needed = [Requirement(text) for text in PROJECT["dependencies"] + optional["dev"] + optional["docs"]]
    environment = {"python_version": PYTHONS[python], "python_full_version": f"{PYTHONS[python]}.0"}
    for requirement in needed:
        if requirement.marker is None or requirement.marker.evaluate(environment):
            name = re.sub(r"[-_.]+", "-", requirement.name).lower()
            assert name in pinned, f"{requirement.name} is not in constraints/py{python}.txt"
            assert requirement.specifier.contains(pinned[name]), requirement
    assert "nas-data" not in pinned
