"""The pages of docs/results are what their tables make."""

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
TOPICS = ("experiments", "ergo_reacher", "so101", "xl330", "robots", "blind")
DECIMAL = re.compile(r"(?<![\w.-])\d+\.\d+")
NOT_QUOTED = re.compile(r"\{\{.*?\}\}|```.*?```|`[^`]*`|\]\([^)]*\)", re.DOTALL)


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
        ("so101", "so101.csv", "2.004"),
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
