"""The pages of docs/results are what their tables make, and every link of the documentation leads somewhere."""

import importlib
import re
import shutil
import sys
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

ROOT = Path(__file__).parents[2]
RESULTS = ROOT / "docs/results"
MOST_FILES = 60
TOPICS = ("experiments", "ergo_reacher", "so101", "xl330", "blind")
LINK = re.compile(r"\]\(([^()\s]+)\)")
DECIMAL = re.compile(r"(?<![\w.-])\d+\.\d+")
NOT_QUOTED = re.compile(r"\{\{.*?\}\}|```.*?```|`[^`]*`|\]\([^)]*\)", re.DOTALL)
PAGES = sorted(
    path
    for pattern in ("*.md", "docs/**/*.md", "datasets/*.md", "lerobot_robot_ergojr/*.md")
    for path in ROOT.glob(pattern)
)


@pytest.fixture(autouse=True)
def scripts(monkeypatch):
    monkeypatch.syspath_prepend(str(RESULTS))
    yield
    for name in ("pages", *TOPICS):
        sys.modules.pop(name, None)


def make(topic: str, folder: Path) -> str:
    return importlib.import_module(topic).make_page(folder)


@pytest.mark.parametrize("topic", TOPICS)
def test_a_page_is_what_its_tables_make(topic):
    assert make(topic, RESULTS) == (RESULTS / f"{topic}.md").read_text(encoding="utf-8"), (
        f"docs/results/{topic}.md is not what its tables make; run python docs/results/{topic}.py"
    )


@pytest.mark.parametrize("topic", TOPICS)
def test_a_decimal_number_of_a_page_is_computed_or_given(topic):
    template = (RESULTS / f"{topic}.md.j2").read_text(encoding="utf-8")
    typed = set(DECIMAL.findall(NOT_QUOTED.sub(" ", template)))
    assert typed <= importlib.import_module(topic).GIVEN


@pytest.mark.parametrize(
    ("topic", "table", "old"),
    [
        ("experiments", "experiments/runs.csv", "-66.19539225795126"),
        ("ergo_reacher", "ergo_reacher.csv", "-0.3714594915391315"),
        ("so101", "so101.csv", "1.87"),
        ("xl330", "xl330.csv", "11.123"),
    ],
)
def test_another_number_in_a_table_makes_another_page(topic, table, old, tmp_path):
    folder = shutil.copytree(RESULTS, tmp_path / "results", ignore=shutil.ignore_patterns("*.png"))
    text = (folder / table).read_text(encoding="utf-8")
    assert old in text
    (folder / table).write_text(text.replace(old, "12.5", 1), encoding="utf-8")
    assert make(topic, folder) != (RESULTS / f"{topic}.md").read_text(encoding="utf-8")


def test_another_case_makes_another_page(tmp_path):
    shutil.copy(RESULTS / "blind.md.j2", tmp_path)
    table = pq.read_table(RESULTS / "blind.parquet")
    cases = table.to_pylist()
    case = next(case for case in cases if case["case"] == "one-numpy-15-0000")
    case["exact"] = not case["exact"]
    pq.write_table(pa.Table.from_pylist(cases, schema=table.schema), tmp_path / "blind.parquet")
    assert make("blind", tmp_path) != (RESULTS / "blind.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("topic", ["experiments", "so101"])
def test_each_picture_of_a_script_is_there(topic):
    assert [name for name in importlib.import_module(topic).PICTURES if not (RESULTS / name).is_file()] == []


def test_the_results_stay_few_files():
    assert sum(path.is_file() and "__pycache__" not in path.parts for path in RESULTS.rglob("*")) < MOST_FILES


def anchors(page: Path) -> set[str]:
    """Return where links into a page may lead: its headings as GitHub names them, and its ids."""
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    found = set(re.findall(r'id="([^"]+)"', text))
    for heading in re.findall(r"^#+ +(.*)$", text, re.MULTILINE):
        plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).replace("`", "").strip().lower()
        found.add(re.sub(r"[^\w\- ]", "", plain).replace(" ", "-"))
    return found


def broken(page: Path) -> list[str]:
    """Return the links of a page, within the project, that lead nowhere."""
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    lost = []
    for link in LINK.findall(text):
        if re.match(r"[a-z]+:", link):
            continue
        path, _, anchor = link.partition("#")
        target = page.parent / path if path else page
        if not target.exists() or (anchor and target.suffix == ".md" and anchor not in anchors(target)):
            lost.append(link)
    return lost


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_each_link_leads_somewhere(page):
    assert broken(page) == []


def test_a_link_that_leads_nowhere_is_found(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("# One `b`, two\n[a](#one-b-two) [b](#three) [c](gone.md) [d](page.md#one) [e](https://x.org/y)\n")
    assert broken(page) == ["#three", "gone.md", "page.md#one"]
