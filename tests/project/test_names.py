"""Names mean one thing in the whole package, and what scripts beside it import is there."""

import ast
import importlib.util
from collections import defaultdict
from pathlib import Path
from types import ModuleType

import pytest

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


ROOT = PACKAGE.parent
SCRIPTS = sorted(
    path for place in ("docs", "examples", "lerobot_robot_ergojr") for path in (ROOT / place).rglob("*.py")
)


def missing(path: Path) -> list[str]:
    """Return what a script imports from the package that is not there."""
    gone = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "nas_data":
            try:
                module = importlib.import_module(node.module)
            except ModuleNotFoundError:
                gone.append(node.module)
                continue
            gone += [f"{node.module}.{alias.name}" for alias in node.names if not has(module, alias.name)]
    return gone


def has(module: ModuleType, name: str) -> bool:
    """Whether a module has a name, or a package a module of that name."""
    in_folder = hasattr(module, "__path__") and importlib.util.find_spec(f"{module.__name__}.{name}") is not None
    return hasattr(module, name) or in_folder


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_what_a_script_imports_is_there(path):
    assert missing(path) == []


def test_an_import_that_is_not_there_is_found(tmp_path):
    script = tmp_path / "script.py"
    script.write_text("from nas_data.robots.base import find_robot, gone\nfrom nas_data.gone import here\n")
    assert missing(script) == ["nas_data.robots.base.gone", "nas_data.gone"]
