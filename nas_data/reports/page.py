"""A page that needs nothing but itself: paragraphs, tables and pictures in one HTML file."""

import base64
import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

STYLE = Path(__file__).with_name("page.css")
GENERATOR = '<meta name="generator" content="nas_data">'  # by which a page of ours is known, and may be replaced


@dataclass(frozen=True)
class Picture:
    """A figure with its caption.

    Attributes:
        name: File's name without `.png`.
        png: The picture.
        caption: What it shows.
    """

    name: str
    png: bytes
    caption: str

    def to_html(self) -> str:
        """Return the picture with its bytes inside."""
        data = base64.b64encode(self.png).decode()
        text = html.escape(self.caption)
        return f'<figure><img alt="{text}" src="data:image/png;base64,{data}"><figcaption>{text}</figcaption></figure>'


@dataclass(frozen=True)
class HtmlTable:
    """Rows under headers; the first column names the row, the others are numbers.

    Attributes:
        headers: One a column.
        rows: Cells as text.
        note: What the numbers are, shown below.
    """

    headers: Sequence[str]
    rows: Sequence[Sequence[str]]
    note: str = ""

    def to_html(self) -> str:
        """Return the table, which scrolls by itself where the page is narrow."""
        head = "".join(f"<th>{html.escape(header)}</th>" for header in self.headers)
        body = "".join(
            f"<tr><th>{html.escape(row[0])}</th>{''.join(f'<td>{html.escape(cell)}</td>' for cell in row[1:])}</tr>"
            for row in self.rows
        )
        note = f'<p class="note">{html.escape(self.note)}</p>' if self.note else ""
        return f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>{note}'


@dataclass(frozen=True)
class Facts:
    """Names and what is to be known under them, for hardware, seeds and versions."""

    entries: Mapping[str, str]

    def to_html(self) -> str:
        """Return them as a table of two columns."""
        rows = "".join(
            f"<tr><th>{html.escape(name)}</th><td>{html.escape(value)}</td></tr>"
            for name, value in self.entries.items()
        )
        return f'<div class="scroll"><table class="facts"><tbody>{rows}</tbody></table></div>'


@dataclass(frozen=True)
class Text:
    """A paragraph; the lead is set larger."""

    text: str
    lead: bool = False

    def to_html(self) -> str:
        """Return the paragraph."""
        return f"<p{' class=lead' if self.lead else ''}>{html.escape(self.text)}</p>"


Block = Picture | HtmlTable | Facts | Text


@dataclass(frozen=True)
class PageSection:
    """A heading and what stands below it; no heading at a page's start."""

    title: str
    blocks: Sequence[Block]

    def to_html(self) -> str:
        """Return the section."""
        heading = f"<h2>{html.escape(self.title)}</h2>\n" if self.title else ""
        return heading + "\n".join(block.to_html() for block in self.blocks)


@dataclass(frozen=True)
class HtmlPage:
    """A whole page."""

    title: str
    sections: Sequence[PageSection]

    def pictures(self) -> list[Picture]:
        """Return the pictures of all sections."""
        return [block for section in self.sections for block in section.blocks if isinstance(block, Picture)]

    def to_html(self) -> str:
        """Return the page; it asks no server for anything."""
        title = html.escape(self.title)
        body = "\n".join(section.to_html() for section in self.sections)
        return (
            '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
            f'<meta name="viewport" content="width=device-width, initial-scale=1">\n{GENERATOR}\n'
            f"<title>{title}</title>\n<style>\n{STYLE.read_text(encoding='utf-8')}</style>\n</head>\n"
            f"<body>\n<h1>{title}</h1>\n{body}\n</body>\n</html>\n"
        )


def is_ours(path: Path) -> bool:
    """Whether a file is a page that this package wrote."""
    return GENERATOR in path.read_text(encoding="utf-8", errors="replace")[:1000]
