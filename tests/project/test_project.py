"""The project as a whole: what is shipped is complete and clean."""

import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
import tyro
from packaging.requirements import Requirement

from nas_data.cli import load_command_class, split

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
PYTHONS = {"311": "3.11", "312": "3.12"}

MACHINE_PATH = re.compile(r"/(?:work|tmp|root|farm|home|Users)/\w")
MARKED = re.compile(r"<!-- test(: slow)? -->\s*```(bash|python)\n(.*?)```", re.DOTALL)
PAGES = ["README.md", *sorted(path.relative_to(ROOT).as_posix() for path in (ROOT / "docs").rglob("*.md"))]
GUIDES = [page for page in PAGES if not page.startswith(("docs/results/", "docs/log/"))]
OWN_TEST = "docs/your_arm.md"  # whose blocks read what its own test writes


def own_files() -> list[Path]:
    """Return every file of the project as git sees it: tracked, or new and not ignored."""
    if not (ROOT / ".git").exists():
        pytest.skip("not a git checkout: which files are the project's is not known")
    listed = ["git", "ls-files", "--cached", "--others", "--exclude-standard", "-z"]
    names = subprocess.run(listed, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    return [path for name in names.split("\0") if name and (path := ROOT / name).is_file()]


# Files


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


# Pages


def marked_blocks(page: str, slow: bool) -> list[tuple[str, str]]:
    """Return language and text of a page's blocks that run; the slow ones only where asked for, in their places."""
    found = MARKED.findall((ROOT / page).read_text(encoding="utf-8"))
    return [(language, text) for mark, language, text in found if slow or not mark]


RUN = [page for page in PAGES if page != OWN_TEST and marked_blocks(page, slow=False)]
SLOW = [page for page in RUN if marked_blocks(page, slow=True) != marked_blocks(page, slow=False)]


@pytest.fixture
def clone(tmp_path) -> Path:
    """A copy of the project, as a reader has it, with the program `nas` of this copy in `bin`."""
    root = tmp_path / "clone"
    for path in own_files():
        target = root / path.relative_to(ROOT)
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(path, target)
    program = root / "bin/nas"
    program.parent.mkdir(parents=True)
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m nas_data "$@"\n')
    program.chmod(0o755)
    return root


def run_page(clone: Path, page: str, slow: bool) -> None:
    """Run the blocks of a page, one after the other, at the root of the copy."""
    search = f"{clone / 'bin'}{os.pathsep}{os.environ['PATH']}"
    environment = {**os.environ, "PATH": search, "PYTHONPATH": str(clone)}
    for language, block in marked_blocks(page, slow):
        shell = ["bash", "-euo", "pipefail", "-c"] if language == "bash" else [sys.executable, "-c"]
        run = subprocess.run([*shell, block], cwd=clone, env=environment, capture_output=True, text=True)
        assert run.returncode == 0, f"a block of {page} failed:\n{block}\n{run.stdout}\n{run.stderr}"


@pytest.mark.parametrize(
    "page", [pytest.param(page, marks=pytest.mark.slow if page == "docs/ergojr.md" else ()) for page in RUN]
)
def test_the_marked_blocks_of_a_page_run(clone, page):
    run_page(clone, page, slow=False)


@pytest.mark.slow
@pytest.mark.parametrize("page", SLOW)
def test_the_slow_blocks_of_a_page_run_among_the_others(clone, page):
    run_page(clone, page, slow=True)


def test_the_readme_and_the_pages_that_begin_have_marked_blocks():
    assert {"README.md", "docs/first_report.md", "docs/ergojr.md"} <= set(RUN)
    assert {language for language, _ in marked_blocks("README.md", slow=True)} == {"bash", "python"}


def typed(path: Path) -> list[str]:
    """Return the commands of ours in the blocks of a page, without the program's name and what a shell adds."""
    blocks = re.findall(r"```bash\n(.*?)```", path.read_text(encoding="utf-8").replace("\\\n", " "), re.DOTALL)
    return [line.strip() for block in blocks for line in block.splitlines() if line.strip().startswith("nas ")]


COMMANDED = [page for page in [*GUIDES, "lerobot_robot_ergojr/README.md"] if typed(ROOT / page)]


def test_the_pages_with_commands_are_found():
    expected = {"README.md", "docs/ergojr.md", "docs/lerobot_arms.md", "docs/your_arm.md", "docs/paper.md"}
    assert expected <= set(COMMANDED)


@pytest.mark.parametrize("page", COMMANDED)
def test_each_command_of_a_page_can_be_typed(page):
    for command in typed(ROOT / page):
        name, options = split(shlex.split(command, comments=True)[1:])
        assert name, command
        kind = load_command_class(name)
        assert isinstance(tyro.cli(kind, args=options, config=(tyro.conf.FlagCreatePairsOff,)), kind), command


def test_a_block_is_found_only_below_its_mark():
    text = (
        "```bash\nfalse\n```\n<!-- test -->\n```bash\ntrue\n```\n<!-- test: slow -->\n\n```python\na = 1\nb = 2\n```\n"
    )
    assert MARKED.findall(text) == [("", "bash", "true\n"), (": slow", "python", "a = 1\nb = 2\n")]
