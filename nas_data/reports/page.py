"""A page that needs nothing but itself: paragraphs, tables, charts, differences and films in one HTML file."""

import base64
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from nas_data.count_of import count_of

if TYPE_CHECKING:
    from jinja2 import Template

TEMPLATES = Path(__file__).with_name("templates")
GENERATOR = '<meta name="generator" content="nas_data">'  # by which a page of ours is known, and may be replaced


@dataclass(frozen=True)
class Text:
    """A paragraph; the lead is set larger."""

    text: str
    lead: bool = False


@dataclass(frozen=True)
class HtmlTable:
    """Rows under headers, which a click on a header sorts; the first column names the row, the others are numbers."""

    headers: Sequence[str]  # one a column
    rows: Sequence[Sequence[str]]  # cells as text
    note: str = ""  # what the numbers are, shown below


@dataclass(frozen=True)
class Facts:
    """Names and what is to be known under them, for hardware, seeds and versions."""

    entries: Mapping[str, str]


@dataclass(frozen=True)
class Chart:
    """An interactive picture, drawn by plotly.js in the reader's browser."""

    name: str  # a word that tells it from the other charts of the page
    caption: str  # what it shows
    traces: Sequence[Mapping[str, object]]  # what is drawn, as plotly.js takes it; arrays are NumPy's
    # axes and shapes, as plotly.js takes them; the page adds fonts, margins and colours
    layout: Mapping[str, object] = field(default_factory=dict)
    height: int = 380  # of the picture [px]

    def to_json(self) -> str:
        """Return traces and layout; no text in it ends the script element in which it stands."""
        text = json.dumps({"data": self.traces, "layout": self.layout}, default=pack_array, ensure_ascii=False)
        return text.replace("<", "\\u003c")


@dataclass(frozen=True)
class ModelDifference:
    """A unified difference of two texts, to read and to copy."""

    text: str  # as `diff -u` writes it
    note: str = ""  # what the two texts are

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
        """How many lines are added and removed."""
        kinds = [kind for kind, _ in self.lines]
        return f"{count_of(kinds.count('added'), 'line')} added, {kinds.count('removed')} removed"


@dataclass(frozen=True)
class ShortFilm:
    """A film inside the page."""

    mp4: bytes  # H.264, which browsers play
    caption: str  # what it shows

    @property
    def source(self) -> str:
        """The film as a data address."""
        return "data:video/mp4;base64," + base64.b64encode(self.mp4).decode()


Block = Text | HtmlTable | Facts | Chart | ModelDifference | ShortFilm


@dataclass(frozen=True)
class PageSection:
    """A heading and what stands below it; no heading at a page's start."""

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

    def to_html(self) -> str:
        """Return the page; it asks no server for anything."""
        library = load_plotly_js() if self.charts() else ""
        return load_page_template().render(page=self, generator=GENERATOR, library=library)


@cache
def load_page_template() -> "Template":
    """Return the template of every page."""
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
    """Return an array as plotly.js takes it: numbers as base64, 4 bytes each, words as a list."""
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
