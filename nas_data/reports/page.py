"""Self-contained HTML pages: paragraphs, tables, charts, differences and films in one file."""

import base64
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from nas_data.count_of import count_of

if TYPE_CHECKING:
    from jinja2 import Template

TEMPLATES = Path(__file__).with_name("templates")
GENERATOR = '<meta name="generator" content="nas_data">'  # identifies pages of this package, which may be replaced


@dataclass(frozen=True)
class Text:
    """A paragraph; a lead has larger type."""

    text: str
    lead: bool = False


@dataclass(frozen=True)
class HtmlTable:
    """Rows under headers; a click on a header sorts. The first column names the row, the others are numbers."""

    headers: Sequence[str]  # one per column
    rows: Sequence[Sequence[str]]  # cells as text
    note: str = ""  # explanation of the numbers, shown below


@dataclass(frozen=True)
class Facts:
    """Names with their values, for hardware, seeds and versions."""

    entries: Mapping[str, str]


@dataclass(frozen=True)
class Chart:
    """An interactive figure, drawn by plotly.js in the browser."""

    name: str  # id on the page; of several with one name, the first has it
    caption: str  # caption
    traces: Sequence[Mapping[str, object]]  # traces for plotly.js, with NumPy arrays
    # axes and shapes for plotly.js; the page adds fonts, margins and colours
    layout: Mapping[str, object] = field(default_factory=dict)
    height: int = 380  # height [px]

    def to_json(self) -> str:
        """Return traces and layout, escaped so that they cannot end the enclosing script element."""
        text = json.dumps({"data": self.traces, "layout": self.layout}, default=pack_array, ensure_ascii=False)
        return text.replace("<", "\\u003c")


@dataclass(frozen=True)
class ModelDifference:
    """A unified difference of two texts, which can be copied."""

    text: str  # output of `diff -u`
    note: str = ""  # description of the two texts

    @property
    def lines(self) -> list[tuple[str, str]]:
        """Each line with its kind: `head`, `place`, `added`, `removed` or `same`."""
        kinds = {"---": "head", "+++": "head", "@@ ": "place"}
        marks = {"+": "added", "-": "removed"}
        return [
            (kinds.get(line[:3]) or marks.get(line[:1], "same"), line) for line in self.text.splitlines(keepends=True)
        ]

    @property
    def size(self) -> str:
        """Number of added and removed lines."""
        kinds = [kind for kind, _ in self.lines]
        return f"{count_of(kinds.count('added'), 'line')} added, {kinds.count('removed')} removed"


@dataclass(frozen=True)
class ShortFilm:
    """A film embedded in the page."""

    mp4: bytes  # H.264, which browsers play
    caption: str  # caption

    @property
    def source(self) -> str:
        """The film as a data URL."""
        return "data:video/mp4;base64," + base64.b64encode(self.mp4).decode()


Block = Text | HtmlTable | Facts | Chart | ModelDifference | ShortFilm


@dataclass(frozen=True)
class PageSection:
    """A heading and its content; no heading at the start of a page."""

    title: str
    blocks: Sequence[Block]


@dataclass(frozen=True)
class HtmlPage:
    """A whole page."""

    title: str
    sections: Sequence[PageSection]

    def charts(self) -> list[Chart]:
        """Return the charts of all sections."""
        return [block for section in self.sections for block in section.blocks if isinstance(block, Chart)]

    def has_id(self, chart: Chart) -> bool:
        """Whether a chart has its name as id: the first one of that name; a page may show several runs."""
        return chart is next((other for other in self.charts() if other.name == chart.name), None)

    @property
    def anchored(self) -> list[tuple[str, PageSection]]:
        """The sections, each with a name of its own to link to: its title, with a number where titles repeat."""
        found: list[tuple[str, PageSection]] = []
        for section in self.sections:
            taken = {anchor for anchor, _ in found}
            names = (f"{section.title} {number}" if number else section.title for number in count())
            found.append((next(name for name in names if not name or name not in taken), section))
        return found

    def to_html(self) -> str:
        """Return the page; it loads nothing from servers."""
        library = load_plotly_js() if self.charts() else ""
        return load_page_template().render(page=self, generator=GENERATOR, library=library)


@cache
def load_page_template() -> "Template":
    """Return the template of all pages."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["kind"] = lambda block: type(block).__name__
    return environment.get_template("page.html.j2")


@cache
def load_plotly_js() -> str:
    """Return plotly.js."""
    from plotly.offline import get_plotlyjs

    return str(get_plotlyjs())


def pack_array(values: object) -> object:
    """Return an array for plotly.js: numbers as base64 of 4 bytes each, words as a list."""
    if not isinstance(values, np.ndarray):
        raise TypeError(f"{values!r} cannot be drawn")
    if values.dtype.kind not in "fiu":
        return values.tolist()
    content = base64.b64encode(np.ascontiguousarray(values, "<f4").tobytes()).decode()
    shape = {"shape": ", ".join(map(str, values.shape))} if values.ndim > 1 else {}
    return {"dtype": "f4", "bdata": content, **shape}


def is_ours(path: Path) -> bool:
    """Whether a file is a page that this package wrote."""
    return GENERATOR in path.read_text(encoding="utf-8", errors="replace")[:1000]
