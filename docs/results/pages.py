"""Make the pages of this folder and their pictures from their tables.

Run `python docs/results/pages.py`.

Each page has a template, a script of the same name that computes what the template asks for, and tables. Whoever
changes a table or a template runs this; a test holds each page to what it makes.
"""

import csv
import importlib
import sys
from collections.abc import Callable, Iterable, Sequence
from decimal import ROUND_HALF_UP, Decimal
from pathlib import Path

import jinja2

HERE = Path(__file__).parent
TOPICS = ("experiments", "ergo_reacher", "so101", "xl330", "robots", "blind")
Row = dict[str, str]


def read_table(path: Path) -> list[Row]:
    """Read a CSV file: a row is a dictionary of texts, empty where nothing is known."""
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def write_table(path: Path, rows: Sequence[dict[str, object]]) -> None:
    """Write a CSV file; floats are written so that they read back the same."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def render(template: Path, values: object) -> str:
    """Fill a template in; it may call every public method of `values`."""
    loader = jinja2.FileSystemLoader(template.parent)
    environment = jinja2.Environment(
        loader=loader, undefined=jinja2.StrictUndefined, keep_trailing_newline=True, autoescape=False
    )
    public = {name: getattr(values, name) for name in dir(values) if not name.startswith("_")}
    return environment.get_template(template.name).render(public)


def number(value: float, digits: int = 1) -> str:
    """Write a number with so many digits behind the point and a true minus sign; halves are rounded up."""
    rounded = Decimal(repr(float(value))).quantize(Decimal(1).scaleb(-digits), ROUND_HALF_UP)
    return f"{rounded}".replace("-", "−")


def numbers(values: Iterable[float], digits: int = 1) -> str:
    """Write several numbers, a comma between two."""
    return ", ".join(number(value, digits) for value in values)


def markdown_table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Write a Markdown table."""
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join(f"| {' | '.join(cells)} |".replace("|  |", "| |").replace("|  |", "| |") for cells in lines)


def write_page(name: str, text: str, pictures: dict[str, Callable[[], bytes]]) -> None:
    """Write a page and its pictures."""
    (HERE / f"{name}.md").write_text(text, encoding="utf-8")
    for path, draw in pictures.items():
        (HERE / path).write_bytes(draw())
    print(f"{name}.md and {len(pictures)} pictures")


def main() -> None:
    """Make all pages."""
    sys.path.insert(0, str(HERE))
    for topic in TOPICS:
        module = importlib.import_module(topic)
        write_page(topic, module.make_page(HERE), getattr(module, "PICTURES", {}))


if __name__ == "__main__":
    main()
