"""The blocks of the documentation run, one after the other, as a reader types them.

A comment above each block says how: `test` in the default run, `test: slow` with the slow tests, `test: smaller` there,
too, at the sizes of `SMALLER`, and `no test: why` not at all.
"""

import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import tyro
from support import page_inputs

from nas_data.cli import load_command_class, split

ROOT = Path(__file__).parents[2]
PAGES = sorted(
    path.relative_to(ROOT).as_posix()
    for pattern in ("*.md", "docs/**/*.md", "datasets/*.md", "lerobot_robot_ergojr/*.md")
    for path in ROOT.glob(pattern)
)
BLOCK = re.compile(r"(?:<!-- ([^\n]*) -->\s*)?^ *```(bash|python)\n(.*?)^ *```", re.DOTALL | re.MULTILINE)
OWN_TESTS = ("CONTRIBUTING.md", "docs/python.md")  # test_contributing.py and tests/api/test_api.py run all of theirs
INPUTS = {
    "docs/ergojr.md": page_inputs.train_policies,
    "docs/examples.md": page_inputs.write_long_recording,
    "docs/pages.md": page_inputs.record_pendulum,
    "docs/render.md": page_inputs.record_so101,
    "docs/so101.md": page_inputs.write_so101_logs,
    "docs/your_arm.md": page_inputs.write_logs,
}
TINY_EXPERIMENTS = ("docs/paper.md", "docs/results/experiments.md")
FEWER_UPDATES = (r"(nas train \w+ \S+ --out \S+)", r"\1 --hidden 8 --updates 2")
INSTALL = r"python -m pip install -q --no-deps --no-build-isolation --no-index --target plugins \1\n"
INSTALL += "export PYTHONPATH=$PWD/plugins:$PYTHONPATH"
VIRTUAL = (r"--port /dev/ttyUSB0", "--port virtual")
SMALLER: dict[str, list[tuple[str, str]]] = {
    "docs/ergojr.md": [  # nobody holds a virtual arm upright to calibrate it, as the page says
        VIRTUAL,
        (r"(?<=port virtual) +# who", " #"),
        (
            r"nas robot ergojr --port virtual --calibrate.*",
            "true",
        ),
        (r"--episodes 10 --name try", "--episodes 2 --seconds 1 --lockstep --name try"),
        (r"--name arm", r"--episodes 12 --seconds 2 --lockstep --name arm"),
        FEWER_UPDATES,
        (r"--episodes 10 --record", "--episodes 2 --lockstep --record"),
        (r"--defender-port /dev/ttyUSB1 \\\n *--hits \S+", "--defender-port virtual --episodes 1 --lockstep"),
        (r"--port virtual --blind", r"\g<0> --episodes 2 --seconds 1 --lockstep"),
    ],
    "docs/lerobot_arms.md": [
        (r"--robot.port=/dev/ttyACM0 --robot.id=my_arm --episodes 20", "--port virtual --episodes 2 --lockstep")
    ],
    "docs/paper.md": [(r"--workers 2", "--workers 1")],
    "docs/render.md": [(r"--episode 3$", "--episode 3 --out both.rrd")],
    "docs/results/blind.md": [
        (r"--families \S+", "--families one"),
        (r"--cases \d+", "--cases 1"),
        (r"--plants numpy,bullet", "--plants numpy"),
    ],
    "docs/results/ergo_reacher.md": [
        (r"--episodes 50 --seconds 3", "--episodes 3 --seconds 1"),
        (r"--updates \d+", "--updates 2 --hidden 8"),
        (r"--frames 400000 --workers 2", "--frames 8192 --seed 0 --episodes 2"),
    ],
    "docs/results/experiments.md": [
        (r"--counts [\d ]+\d", "--counts 2 4"),
        (r"--seeds [\d ]+\d", "--seeds 0"),
        (r"--rounds 60", "--rounds 1"),
    ],
    "docs/so101.md": [
        FEWER_UPDATES,
        (r"--minutes 1,2,5,all", "--minutes 0.1,all --seeds 0 --updates 2"),
    ],
    "docs/transfer.md": [
        (r"--episodes 200 --seconds 3", "--episodes 12 --seconds 1"),
        FEWER_UPDATES,
        (r"--seed 0 1 2 3 4|(?<=phi_named)$", " --seed 0 --frames 8192"),
        (r"--on target", r"\g<0> --episodes 2"),
        (r"--port /dev/ttyUSB0 --episodes 10", "--port virtual --lockstep --episodes 2"),
    ],
    "lerobot_robot_ergojr/README.md": [(r"pip install (\S+)", INSTALL)],
}


def read_blocks(page: str) -> list[tuple[str, str, str]]:
    """Return mark, language and text of a page's blocks."""
    return BLOCK.findall((ROOT / page).read_text(encoding="utf-8"))


def shrink(page: str, text: str) -> str:
    """Return a block at its page's smaller sizes."""
    for pattern, replacement in SMALLER[page]:
        text = re.sub(pattern, replacement, text, flags=re.MULTILINE)
    return text


def select_blocks(page: str, slow: bool) -> list[tuple[str, str]]:
    """Return language and text of the blocks that run; the slow ones only where asked for, in their places."""
    marks = ("test", "test: slow", "test: smaller") if slow else ("test",)
    found = [block for block in read_blocks(page) if block[0] in marks]
    return [(language, shrink(page, text) if mark == "test: smaller" else text) for mark, language, text in found]


TESTED = [page for page in PAGES if page not in OWN_TESTS]
QUICK = [page for page in TESTED if select_blocks(page, slow=False)]
SLOW = [page for page in TESTED if len(select_blocks(page, slow=True)) > len(select_blocks(page, slow=False))]


@pytest.fixture
def clone(tmp_path) -> Path:
    """A copy of the project, as a reader has it, with the program `nas` of this copy in `bin`."""
    if not (ROOT / ".git").exists():
        pytest.skip("not a git checkout: which files are the project's is not known")
    listed = ["git", "ls-files", "--cached", "--others", "--exclude-standard", "-z"]
    names = subprocess.run(listed, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    root = tmp_path / "clone"
    for name in filter(None, names.split("\0")):
        if (ROOT / name).is_file():
            (root / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, root / name)
    return root


def write_programs(root: Path, before: str) -> None:
    """Write `nas` and `python` of the copy into its `bin`; `nas` does something first."""
    (root / "bin").mkdir()
    (root / "bin/main.py").write_text(f"{before}\nfrom nas_data.cli import main\nraise SystemExit(main())\n")
    for name, arguments in (("nas", f'"{root}/bin/main.py" "$@"'), ("python", '"$@"')):
        (root / "bin" / name).write_text(f'#!/bin/sh\nexec "{sys.executable}" {arguments}\n')
        (root / "bin" / name).chmod(0o755)


def run_page(root: Path, page: str, slow: bool) -> None:
    """Run the blocks of a page, one after the other, at the root of the copy."""
    tiny = "from support.page_inputs import shrink_experiments\nshrink_experiments()"
    write_programs(root, tiny if page in TINY_EXPERIMENTS else "")
    if page in INPUTS:
        INPUTS[page](root)
    search = os.pathsep.join((str(root / "bin"), os.environ["PATH"]))
    environment = {**os.environ, "PATH": search, "PYTHONPATH": f"{root}{os.pathsep}{root / 'tests'}"}
    for language, block in select_blocks(page, slow):
        shell = ["bash", "-euo", "pipefail", "-c"] if language == "bash" else [sys.executable, "-c"]
        run = subprocess.run([*shell, block], cwd=root, env=environment, capture_output=True, text=True)
        assert run.returncode == 0, f"a block of {page} failed:\n{block}\n{run.stdout}\n{run.stderr}"
        assert "contradicts" not in run.stdout + run.stderr


@pytest.mark.parametrize("page", QUICK)
def test_the_quick_blocks_of_a_page_run(clone, page):
    run_page(clone, page, slow=False)


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("page", SLOW)
def test_all_blocks_of_a_page_run(clone, page):
    run_page(clone, page, slow=True)


def test_the_pages_that_a_newcomer_reads_first_run_by_default():
    assert {"README.md", "docs/first_report.md", "docs/your_arm.md"} <= set(QUICK)
    assert {"docs/transfer.md", "docs/so101.md", "docs/ergojr.md", "docs/examples.md"} <= set(SLOW)


@pytest.mark.parametrize("page", TESTED)
def test_each_block_says_how_it_is_run_or_why_not(page):
    marks = [mark for mark, *_ in read_blocks(page)]
    assert all(re.fullmatch(r"test(: slow|: smaller)?|no test: .+", mark) for mark in marks), marks


@pytest.mark.parametrize("page", SMALLER)
def test_each_smaller_size_is_one_of_its_page(page):
    text = "\n".join(text for mark, _, text in read_blocks(page) if mark == "test: smaller")
    for pattern, replacement in SMALLER[page]:
        smaller = re.sub(pattern, replacement, text, flags=re.MULTILINE)
        assert smaller != text, pattern
        text = smaller


def test_a_mark_is_found_only_right_above_its_block():
    text = (
        "```bash\nfalse\n```\n<!-- test -->\n```bash\ntrue\n```\n<!-- test: slow -->\n\n```python\na = 1\nb = 2\n```\n"
    )
    expected = [("", "bash", "false\n"), ("test", "bash", "true\n"), ("test: slow", "python", "a = 1\nb = 2\n")]
    assert BLOCK.findall(text) == expected


def read_commands(page: str) -> list[str]:
    """Return the commands of ours in the blocks of a page, as far as no shell has to complete them."""
    blocks = [text.replace("\\\n", " ") for _, language, text in read_blocks(page) if language == "bash"]
    lines = [line.strip() for block in blocks for line in block.splitlines()]
    return [line for line in lines if line.startswith("nas ") and "$" not in line]


@pytest.mark.parametrize("page", [page for page in PAGES if read_commands(page)])
def test_each_command_of_a_page_can_be_typed(page):
    for command in read_commands(page):
        name, options = split(shlex.split(command, comments=True)[1:])
        assert name, command
        kind = load_command_class(name)
        assert isinstance(tyro.cli(kind, args=options, config=(tyro.conf.FlagCreatePairsOff,)), kind), command
