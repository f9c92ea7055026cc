"""What the site does beyond mkdocs: formulas as MathML, anchors as on GitHub, links that leave the documentation."""

import html
import re
from pathlib import Path
from posixpath import dirname, join, normpath

from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import Files
from mkdocs.structure.pages import Page
from pymdownx.slugs import slugify

FORMULA = re.compile(r'<(span|div) class="arithmatex">\\([(\[])(.*?)\\[)\]]</\1>', re.DOTALL)
LINK = re.compile(r"(?<!!)\[((?:[^\[\]]|\[[^\[\]]*\])*)\]\(([^()\s#:]+)(#[^()\s]*)?\)")
CODE = re.compile(r"(```.*?```)", re.DOTALL)


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Name anchors as GitHub does, so that a link works in both places."""
    config.mdx_configs.setdefault("toc", {})["slugify"] = slugify(case="lower")
    return config


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Name the file where a link leads to one of the repository that is not part of the site."""

    def replace(link: re.Match[str]) -> str:
        text, target = link[1], link[2]
        path = normpath(join("docs", dirname(page.file.src_uri), target))
        if files.get_file_from_path(path.removeprefix("docs/")) or not (Path(config.docs_dir).parent / path).exists():
            return link[0]
        return text if path in text else f"{text} (`{path}`)"

    parts = CODE.split(markdown)
    return "".join(part if part.startswith("```") else LINK.sub(replace, part) for part in parts)


def on_page_content(content: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Write formulas as MathML, which browsers show by themselves."""

    def replace(formula: re.Match[str]) -> str:
        display = "block" if formula[2] == "[" else "inline"
        return convert(html.unescape(formula[3]).strip(), display=display)

    return FORMULA.sub(replace, content)
