"""A hash of the code that decides a result: what other code made is not mixed with it, nor told as the same."""

import ast
import hashlib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parent
PACKAGE = ROOT.name
APART = ("dataset", "engine_warnings", "errors", "gap.showing", "registry", "reports")  # they store, refuse or show
EMPTY: tuple[object, ...] = (None, [])  # newer versions of Python know more fields, which older code leaves empty


def code_hash(*modules: str) -> str:
    """Return a hash of modules of this package and of all that they import from it when they are imported.

    Comments, docstrings and layout do not count. What a function imports by itself is not followed: it is one of
    several choices (an engine, an effect), of which the caller names the one that is made.

    Args:
        modules: Their full names, for example `nas_data.envs.pusher`.
    """
    found, waiting = dict[str, str](), list(modules)
    while waiting:
        module = waiting.pop()
        if module not in found:
            found[module], imports = studied(module)
            waiting += imports
    listed = "\n".join(f"{module} {digest}" for module, digest in sorted(found.items()))
    return hashlib.sha256(listed.encode()).hexdigest()


@cache
def studied(module: str) -> tuple[str, tuple[str, ...]]:
    """Return the hash of a module by itself, and the modules that it imports; as they were when first asked for."""
    tree = ast.parse(source_of(module))
    imports = tuple(sorted({name for statement in executed(tree) for name in imported(statement)}))
    return hashlib.sha256(meaning(tree).encode()).hexdigest(), imports


def source_of(module: str) -> str:
    """Return the source text of a module of this package."""
    path = file_of(module)
    assert path is not None, f"{module} is no module of {PACKAGE}"
    return path.read_text(encoding="utf-8")


def file_of(module: str) -> Path | None:
    """Return a module's file; None where there is none."""
    place = ROOT.parent.joinpath(*module.split("."))
    return next((path for path in (place.with_suffix(".py"), place / "__init__.py") if path.is_file()), None)


def meaning(node: object) -> str:
    """Return code without comments, docstrings and layout, alike in all versions of Python that read it alike."""
    if isinstance(node, ast.JoinedStr):  # its empty parts come and go between versions
        node = ast.JoinedStr([part for part in node.values if getattr(part, "value", None) != ""])
    if isinstance(node, list):
        return ",".join(meaning(part) for part in node if not is_text(part))
    if not isinstance(node, ast.AST):
        return repr(node)
    parts = ((name, getattr(node, name, None)) for name in node._fields if name != "ctx")
    return f"{type(node).__name__}({' '.join(f'{name}={meaning(part)}' for name, part in parts if part not in EMPTY)})"


def is_text(node: object) -> bool:
    """Whether a part of the code is a docstring, or another text that does nothing."""
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


def executed(tree: ast.Module) -> Iterator[ast.stmt]:
    """Yield the statements that an import of a module executes, those of type checkers left out."""
    for statement in tree.body:
        if isinstance(statement, ast.Try):
            yield from statement.body
        elif not (isinstance(statement, ast.If) and "TYPE_CHECKING" in ast.unparse(statement.test)):
            yield statement


def imported(statement: ast.stmt) -> Iterator[str]:
    """Yield the modules of this package that a statement imports, those that decide no result left out."""
    if isinstance(statement, ast.ImportFrom) and statement.module and statement.module.split(".")[0] == PACKAGE:
        for name in statement.names:
            inner = f"{statement.module}.{name.name}"
            module = inner if file_of(inner) else statement.module
            words = module.removeprefix(PACKAGE).removeprefix(".")
            if words and not any(words == part or words.startswith(f"{part}.") for part in APART):
                yield module
