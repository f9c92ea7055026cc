"""The documentation: short at its front, whole in its links, and built as a site without a warning."""

import importlib.util
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from nas_data.cli import main

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
README = (ROOT / "README.md").read_text(encoding="utf-8")
PAGES = sorted(
    path
    for pattern in ("*.md", "docs/**/*.md", "datasets/*.md", "lerobot_robot_ergojr/*.md")
    for path in ROOT.glob(pattern)
)
LINK = re.compile(r"\]\(([^()\s]+)\)")
FENCED = re.compile(r"```.*?```", re.DOTALL)
HEADING = re.compile(r"^#+ (.+)$", re.MULTILINE)
LOADED = re.compile(r'<(?:script|link|img)[^>]+(?:src|href)="?(https?://[^"> ]+)')  # from a server, while one reads
MOST_WORDS, MOST_PICTURES, FIGURES = 900, 3, 5
LONGEST_SENTENCES = 18.0  # [words] of a page on average
PLAIN = [DOCS / name for name in ("index.md", "install.md", "first_report.md", "transfer.md", "paper.md", "so101.md")]
PLAIN += [DOCS / name for name in ("search.md", "model_features.md", "results/README.md", "results/ergo_reacher.md")]
PLAIN += [DOCS / "format.md", DOCS / "comparison.md", ROOT / "README.md", *sorted((DOCS / "concepts").glob("*.md"))]


def prose(text: str) -> list[str]:
    """Return the sentences of a page, without code, formulas, tables, headings, comments, and what scripts made."""
    text = re.sub(r"<!-- made by .*?<!-- end -->", "\n\n", text, flags=re.DOTALL)
    text = re.sub(r"```.*?```|\$\$.*?\$\$|<!--.*?-->", "\n\n", text, flags=re.DOTALL)
    text = re.sub(r"!\[[^\]]*\]\([^)]*\)", "", text)
    text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", text)
    text = re.sub(r"^\s*(?:#.*|\|.*)$", "", text, flags=re.MULTILINE)
    text = re.sub(r"^\s*(?:[-*]|\d+\.) ", "\n\n", text, flags=re.MULTILINE)
    blocks = [" ".join(block.split()) for block in re.split(r"\n\s*\n", text)]
    sentences = [part for block in blocks for part in re.split(r"(?<=[.!?])\s+(?=[^a-z])", block)]
    return [sentence for sentence in sentences if len(sentence.split()) > 1]


def words_a_sentence(text: str) -> float:
    """Return the mean number of words of a page's sentences."""
    sentences = prose(text)
    return sum(len(sentence.split()) for sentence in sentences) / len(sentences)


def anchors(path: Path) -> set[str]:
    """Return where links into a page may lead: its headings as mkdocs and GitHub name them alike, and its ids."""
    text = FENCED.sub("", path.read_text(encoding="utf-8"))
    headings, ids = HEADING.findall(text), set(re.findall(r'id="([^"]+)"', text))
    plain = [re.sub(r"\[([^\]]*)\]\([^)]*\)|[`*]", r"\1", heading).strip().lower() for heading in headings]
    return ids | {re.sub(r"[\s]+", "-", re.sub(r"[^\w\s-]", "", heading)) for heading in plain}


def broken(path: Path) -> list[str]:
    """Return the links of a page that lead nowhere in the repository."""
    found = []
    for link in LINK.findall(FENCED.sub("", path.read_text(encoding="utf-8"))):
        target, _, anchor = link.partition("#")
        place = path.parent / target if target else path
        if "://" in link or link.startswith("mailto:"):
            continue
        if not place.exists() or (anchor and place.suffix == ".md" and anchor not in anchors(place)):
            found.append(link)
    return found


def test_the_readme_is_short():
    assert len(README.split()) <= MOST_WORDS
    assert README.count("![") <= MOST_PICTURES


def test_each_figure_of_the_readme_stands_on_the_page_that_it_names():
    begin, end = README.index("## What it is good at"), README.index("## Where to go on")
    items = re.findall(r"^\d\. (.*?)(?=^\d\. |^\n|\Z)", README[begin:end], re.DOTALL | re.MULTILINE)
    assert len(items) == FIGURES
    for item in items:
        (link,) = LINK.findall(item)
        page = (ROOT / link.partition("#")[0]).read_text(encoding="utf-8")
        numbers = re.findall(r"\d+(?:\.\d+)?", " ".join(re.findall(r"\*\*(.*?)\*\*", item)))
        assert numbers
        for number in numbers:
            assert re.search(rf"(?<![\d.]){re.escape(number)}(?![\d.]*\d)", page), f"{number} is not in {link}"


@pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_each_link_leads_somewhere(path):
    assert broken(path) == []


def test_a_link_that_leads_nowhere_is_found(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("# A title\n\n[here](page.md#a-title) [gone](gone.md) [no heading](#another) [web](https://a.b)\n")
    assert broken(page) == ["gone.md", "#another"]


def test_every_page_is_in_the_navigation_once():
    def pages(entry: object) -> list[str]:
        if isinstance(entry, str):
            return [entry]
        parts = entry.values() if isinstance(entry, dict) else entry
        return [page for part in parts for page in pages(part)]

    listed = pages(yaml.safe_load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))["nav"])
    assert sorted(listed) == sorted(path.relative_to(DOCS).as_posix() for path in DOCS.rglob("*.md"))


@pytest.mark.parametrize("path", PLAIN, ids=lambda path: str(path.relative_to(ROOT)))
def test_sentences_are_short(path):
    assert words_a_sentence(path.read_text(encoding="utf-8")) <= LONGEST_SENTENCES


def test_words_of_sentences_are_counted():
    code_and_table = "```bash\nnot this one\n```\n\n| nor | this |\n"
    text = f"# No prose\n\nTwo words. Three words [here](a.md).\n\n{code_and_table}- Four words, in an item.\n"
    assert prose(text) == ["Two words.", "Three words here.", "Four words, in an item."]


@pytest.mark.slow
def test_the_site_is_built_without_a_warning(tmp_path):
    if not all(importlib.util.find_spec(name) for name in ("mkdocs", "material", "mkdocstrings", "latex2mathml")):
        pytest.skip("the site's packages are not installed: pip install -e '.[docs]'")
    build = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path / "site")]
    run = subprocess.run(build, cwd=ROOT, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    assert "WARNING" not in run.stderr
    reference = (tmp_path / "site/reference.html").read_text(encoding="utf-8")
    assert all(f'id="nas_data.{name}"' in reference for name in ("Dataset", "identify", "GapReport", "evaluate"))
    assert "<math" in (tmp_path / "site/concepts/objective.html").read_text(encoding="utf-8")
    for page in (tmp_path / "site").rglob("*.html"):
        assert LOADED.findall(page.read_text(encoding="utf-8")) == [], page.name


@pytest.mark.slow
def test_the_readmes_example_prints_what_the_readme_shows(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    shell, shown = re.findall(r"```(?:bash|text)\n(nas record.*?|Explained.*?)```", README, re.DOTALL)
    assert main(shlex.split(shell.replace("\\\n", ""))[1:]) == 0
    assert main(shlex.split("gap datasets/pendulum --model pendulum --out runs/gap")) == 0
    printed = capsys.readouterr().out
    for line in shown.strip().splitlines():
        assert line.removesuffix("…") in printed
