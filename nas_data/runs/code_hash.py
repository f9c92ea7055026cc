"""Hash of the code that determines a result, so that results of different code are not mixed."""

import ast
import hashlib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from nas_data import registry

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT.name
# These modules only store, check or display.
APART = (
    "cli", "commands", "dataset", "errors", "gap.showing", "log", "mjcf.engine_warnings", "registry", "reports",
    "runs.environment_info", "runs.progress", "atomic_file",
)  # fmt: skip
# Functions of these modules import the code of one option each; callers name the modules of chosen options.
CHOOSING = ("envs.loop.dynamics_spec", "simulators.engines")
BLOCKS = ("body", "orelse", "handlers", "finalbody", "cases")  # fields of a statement that hold statements


def hash_code(*modules: str) -> str:
    """Return a hash of modules of this package and of everything they import, at module level or inside functions.

    Comments, docstrings and layout do not count. Everything else does, names of private functions included.

    Every explicit import is followed, with three exceptions:

    - Imports for type checkers only.
    - Modules that only store, check or display: `APART`.
    - Imports inside functions of the modules `CHOOSING`. A plain source must not depend on φ or another engine just
      because the module that builds plants supports them. The caller passes the modules of the chosen options, as
      `DynamicsSpec.modules` does.

    Plug-ins that the registry finds by name (effects, environments, kinds of models) have no explicit import. The
    caller passes them as well.

    Args:
        modules: Their full names, for example `nas_data.envs.pusher`.
    """
    listed = "\n".join(f"{module} {digest}" for module, digest in sorted(collect(*modules).items()))
    return hashlib.sha256(listed.encode()).hexdigest()


def collect(*modules: str) -> dict[str, str]:
    """Return the hash of each module that `hash_code` counts, by name."""
    found, waiting = dict[str, str](), list(modules)
    while waiting:
        module = waiting.pop()
        if module not in found:
            found[module], imports = analyse_module(module)
            waiting += imports
    return found


@cache
def analyse_module(module: str) -> tuple[str, tuple[str, ...]]:
    """Return the hash of a single module, and the modules that it imports; cached at the first call."""
    tree = ast.parse(read_source(module))
    chooses = module.removeprefix(f"{PACKAGE}.") in CHOOSING
    followed = walk_statements(tree, deep=not chooses)
    imports = tuple(sorted({name for statement in followed for name in find_imported_modules(statement)}))
    return hashlib.sha256(normalise_code(tree).encode()).hexdigest(), imports


def read_source(module: str) -> str:
    """Return the source text of a module of this package."""
    path = find_file(module)
    assert path is not None, f"{module} is no module of {PACKAGE}"
    return path.read_text(encoding="utf-8")


def find_file(module: str) -> Path | None:
    """Return a module's file; None if there is none."""
    place = ROOT.parent.joinpath(*module.split("."))
    return next((path for path in (place.with_suffix(".py"), place / "__init__.py") if path.is_file()), None)


def normalise_code(node: object) -> str:
    """Return code as text without comments, docstrings and layout, independent of the Python version."""
    if isinstance(node, list):
        return ",".join([normalise_code(part) for part in node if not is_text(part)])
    if not isinstance(node, ast.AST):
        return repr(node)
    if isinstance(node, ast.JoinedStr):  # its empty parts differ between Python versions
        node = ast.JoinedStr([part for part in node.values if getattr(part, "value", None) != ""])
    # Newer Python versions have more fields, which are empty for older code.
    parts = [(name, getattr(node, name, None)) for name in node._fields if name != "ctx"]
    texts = [f"{name}={normalise_code(part)}" for name, part in parts if part is not None and part != []]
    return f"{type(node).__name__}({' '.join(texts)})"


def is_text(node: object) -> bool:
    """Whether a node is a docstring or another string statement."""
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


def walk_statements(node: ast.AST, deep: bool) -> Iterator[ast.stmt]:
    """Yield the statements of a module, without those for type checkers; `deep` includes those inside functions."""
    aside = isinstance(node, ast.If) and "TYPE_CHECKING" in (getattr(node.test, key, "") for key in ("id", "attr"))
    for block in BLOCKS[1:] if aside else BLOCKS:
        for part in getattr(node, block, ()):
            if isinstance(part, ast.stmt):
                yield part
            if deep or not isinstance(part, ast.FunctionDef | ast.AsyncFunctionDef):
                yield from walk_statements(part, deep)


def find_imported_modules(statement: ast.stmt) -> Iterator[str]:
    """Yield the modules of this package that a statement imports, except those in `APART`."""
    if isinstance(statement, ast.Import):
        names = [name.name for name in statement.names]
    elif isinstance(statement, ast.ImportFrom) and statement.module:
        inner = [f"{statement.module}.{name.name}" for name in statement.names]
        names = [name if is_ours(name) and find_file(name) else statement.module for name in inner]
    else:
        return
    for name in names:
        words = name.removeprefix(PACKAGE).removeprefix(".")
        if is_ours(name) and words and not any(words == part or words.startswith(f"{part}.") for part in APART):
            yield name


def is_ours(module: str) -> bool:
    """Whether a module belongs to this package."""
    return module.split(".")[0] == PACKAGE


def list_gap_modules() -> tuple[str, ...]:
    """Return the modules that determine a gap report: the workflow, which imports the audits, and every effect."""
    return ("nas_data.gap.workflow", *list_effect_modules())


def list_effect_modules() -> tuple[str, ...]:
    """Return the modules of all effects."""
    return tuple(f"nas_data.effects.{name}" for name in registry.list_names("effects"))
