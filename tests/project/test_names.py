"""Names mean one thing in the whole package."""

import ast
from collections import defaultdict
from pathlib import Path

import nas_data

PACKAGE = Path(nas_data.__file__).parent


def classes() -> dict[str, list[str]]:
    """Return the modules in which a class of each name is defined."""
    found = defaultdict(list)
    for path in sorted(PACKAGE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef):
                found[node.name].append(str(path.relative_to(PACKAGE)))
    return found


def test_one_class_name_has_one_meaning():
    found = classes()
    assert "EpisodeBatch" in found
    assert {name: places for name, places in found.items() if len(places) > 1} == {}
