"""The Makefile sets up the environment once, on a Python that runs, and says in a sentence why it cannot."""

import os
import shutil
import subprocess
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
START_SECONDS = 2.0  # [s] within which a second `make` starts its work

# Stands for Python: says its version, makes "environments" that hold only itself, and writes down what it was told.
FAKE_PYTHON = """#!/bin/sh
case "$1" in
  -c) echo {version} ;;
  -m) echo "$@" >> "{log}"
      if [ "$2" = venv ]; then mkdir -p "$4/bin"; cp "$0" "$4/bin/python"; fi ;;
esac
"""

pytestmark = pytest.mark.skipif(shutil.which("make") is None, reason="make is not installed")


@pytest.fixture
def project(tmp_path) -> Path:
    """A copy of what the Makefile looks at, with a folder of its own Pythons first in the path."""
    folder = tmp_path / "project"
    shutil.copytree(ROOT / "constraints", folder / "constraints")
    for name in ("Makefile", "pyproject.toml"):
        shutil.copy(ROOT / name, folder)
    (tmp_path / "bin").mkdir()
    return folder


def add_python(project: Path, name: str, version: str | None) -> Path:
    """Put a Python into the path; one without a version is a shim that fails."""
    path = project.parent / "bin" / name
    text = FAKE_PYTHON.format(version=version, log=project.parent / "log") if version else "#!/bin/sh\nexit 127\n"
    path.write_text(text)
    path.chmod(0o755)
    return path


def make(project: Path, *arguments: str, **variables: str) -> subprocess.CompletedProcess[str]:
    search = f"{project.parent / 'bin'}{os.pathsep}{os.environ['PATH']}"
    kept = {key: value for key, value in os.environ.items() if key not in {"MAKEFLAGS", "MAKELEVEL", "PYTHON"}}
    environment = {**kept, "PATH": search, **variables}
    return subprocess.run(["make", *arguments], cwd=project, env=environment, capture_output=True, text=True)


def told(project: Path) -> list[str]:
    """Return what the Pythons were told to do, in a word each, and forget it."""
    log = project.parent / "log"
    lines = log.read_text().splitlines() if log.exists() else []
    log.unlink(missing_ok=True)
    return [line.split()[2] if line.startswith("-m pip") else line.split()[1] for line in lines]


def test_the_environment_is_set_up_once_and_again_when_its_packages_change(project):
    add_python(project, "python3.11", "3.11")
    assert make(project, "setup").returncode == 0
    assert told(project) == ["venv", "install"]
    begun = time.perf_counter()
    again = make(project, "setup")
    assert time.perf_counter() - begun < START_SECONDS
    assert again.returncode == 0
    assert told(project) == []
    for changed in ("pyproject.toml", "constraints/py311.txt"):
        later = time.time() + 10
        os.utime(project / changed, (later, later))
        assert make(project, "setup").returncode == 0
        assert told(project) == ["--version", "install"]
        os.utime(project / changed, (1, 1))
    later = time.time() + 10
    os.utime(project / "constraints/py312.txt", (later, later))
    assert make(project, "setup").returncode == 0
    assert told(project) == []


def test_packages_are_installed_under_the_constraints_of_the_python(project):
    add_python(project, "python3.11", "3.11")
    add_python(project, "python3.12", "3.12")
    for python, version in (("python3.11", "py311"), ("python3.12", "py312")):
        assert make(project, "setup", PYTHON=python).returncode == 0
        assert f"-c constraints/{version}.txt -e .[dev]" in (project.parent / "log").read_text()


def test_another_python_has_an_environment_of_its_own(project):
    add_python(project, "python3.11", "3.11")
    add_python(project, "python3.12", "3.12")
    for python in ("python3.11", "python3.12"):
        assert make(project, "setup", PYTHON=python).returncode == 0
    assert {path.name for path in project.glob(".venv*")} == {".venv", ".venv-3.12"}
    told(project)
    for python in ("python3.11", "python3.12"):
        assert make(project, "setup", PYTHON=python).returncode == 0
    assert told(project) == []


def test_a_shim_that_does_not_run_counts_as_absent(project):
    add_python(project, "python3.11", None)
    add_python(project, "python3", "3.12")
    assert make(project, "setup").returncode == 0
    assert "-c constraints/py312.txt" in (project.parent / "log").read_text()
    assert {path.name for path in project.glob(".venv*")} == {".venv"}


def test_an_interrupted_installation_is_taken_up_again(project):
    add_python(project, "python3.11", "3.11")
    assert make(project, "setup").returncode == 0
    told(project)
    (project / ".venv" / ".installed-3.11").unlink()
    assert make(project, "setup").returncode == 0
    assert told(project) == ["--version", "install"]


def test_an_environment_of_another_python_is_made_anew(project):
    add_python(project, "python3.11", None)
    add_python(project, "python3", "3.12")
    assert make(project, "setup").returncode == 0
    add_python(project, "python3.11", "3.11")
    told(project)
    assert make(project, "setup").returncode == 0
    assert told(project)[0] == "venv"


@pytest.mark.parametrize(("version", "said"), [("3.13", "is 3.13"), (None, "is no Python that runs")])
def test_a_python_that_cannot_be_used_is_named_in_one_sentence(project, version, said):
    add_python(project, "python3.11", "3.11")
    add_python(project, "other", version)
    answer = make(project, "setup", PYTHON="other")
    assert answer.returncode == 2
    sentence, *rest = answer.stderr.splitlines()
    assert sentence.startswith(f"nas_data needs Python 3.11 or 3.12, but 'other' {said}")
    assert len(rest) == 1  # make's own
    assert list(project.glob(".venv*")) == []
    assert told(project) == []
