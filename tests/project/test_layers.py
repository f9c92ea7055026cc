"""Dependence runs one way: each part imports from those below it, and heavy libraries load where they are needed."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

# From the bottom to the top, by name below `nas_data`. A module belongs to the longest name that it begins with.
LAYERS = (
    # what everything stands on
    "errors", "count_of", "text_table", "log", "visible_files", "atomic_file", "typed_json", "arrays", "registry",
    "joint_units", "metrics", "command_file", "environment_ids",
    # data, models and engines
    "dataset", "runs", "mjcf", "servos", "robots", "effects", "excitations", "simulators", "pairing",
    "open_loop", "sources",
    "models",
    # the gap and what is learned of it; pages and figures are drawn with what stands before it
    "reports.style", "reports.page", "reports.charts", "reports.films", "gap", "envs",
    # arms and their recordings
    "hardware", "importing", "recorders", "policies",
    # what users call
    "api", "reports", "benchmarks", "studies", "commands", "cli", "__main__", "__init__",
)  # fmt: skip

# What imports from above all the same, and why.
EXCEPTIONS: dict[tuple[str, str], str] = {}

# Where a library may be imported: names of modules, or of packages with all that is in them.
LIBRARIES = {
    "torch": {
        "models", "policies", "api.policy",  # networks
        "importing.formats.pt",  # files that torch wrote
        "benchmarks.augmented", "benchmarks.loading",  # compared with torch's own ways
    },
    "stable_baselines3": {
        "policies", "api.policy", "envs.loop.arm_vec_env", "benchmarks.augmented",
    },
    "pybullet": {"simulators.bullet_world"},
    "dynamixel_sdk": {"hardware.xl320.bus"},
    "scservo_sdk": set(),
    "lerobot": {
        "recorders",
        "benchmarks.datasets", "benchmarks.recording",  # compared with LeRobot's own writer and reader
    },
    "ray": {"runs.executors.ray"},
}  # fmt: skip


def is_in(module: str, part: str) -> bool:
    """Whether a module is a part of the package, or inside it."""
    return module == part or module.startswith(f"{part}.")


def layer(module: str) -> str:
    """Return the layer of a module."""
    return max((part for part in LAYERS if is_in(module, part)), key=len, default="")


def imported(text: str) -> set[str]:
    """Return the full names that code imports, at its head or inside functions."""
    found = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"line {node.lineno} is a relative import"
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return found


def imports_of_modules() -> dict[str, set[str]]:
    """Return what each module of the package imports, by the module's name below `nas_data`."""
    package = ROOT / "nas_data"
    files = {path: ".".join(path.relative_to(package).with_suffix("").parts) for path in sorted(package.rglob("*.py"))}
    return {name.removesuffix(".__init__"): imported(path.read_text(encoding="utf-8")) for path, name in files.items()}


IMPORTS = imports_of_modules()


def of_ours(names: set[str]) -> set[str]:
    """Return the modules of the package that imported names are, or are in."""
    ours = {name.removeprefix("nas_data.") for name in names if is_in(name, "nas_data")} - {"__version__"}
    return {next((whole for whole in (name, name.rpartition(".")[0]) if whole in IMPORTS), "__init__") for name in ours}


def upward(module: str, names: set[str]) -> set[str]:
    """Return what a module imports from layers above its own."""
    own = LAYERS.index(layer(module))
    return {other for other in of_ours(names) if LAYERS.index(layer(other)) > own}


def test_every_module_has_a_layer_and_every_layer_a_module():
    assert {layer(name) for name in IMPORTS} == set(LAYERS)


def test_a_layer_imports_only_from_those_below_it():
    assert {(name, other) for name, names in IMPORTS.items() for other in upward(name, names)} == set(EXCEPTIONS)


@pytest.mark.parametrize("library", LIBRARIES)
def test_a_heavy_library_is_imported_only_where_it_is_needed(library):
    users = {name for name, names in IMPORTS.items() if any(is_in(found, library) for found in names)}
    assert [name for name in users if not any(is_in(name, part) for part in LIBRARIES[library])] == []
    assert [part for part in LIBRARIES[library] if not any(is_in(name, part) for name in users)] == []


def test_imports_inside_functions_are_found_and_judged():
    names = imported("def late():\n    from nas_data.commands.pair import Pair\n    import nas_data.errors")
    assert of_ours(names) == {"commands.pair", "errors"}
    assert upward("gap.report", names) == {"commands.pair"}
    assert of_ours(imported("from nas_data import __version__")) == set()
    assert of_ours(imported("from nas_data import Dataset, registry")) == {"__init__", "registry"}


def test_no_test_file_imports_another():
    """Nor does a text in one that a process of its own runs."""
    files = sorted((ROOT / "tests").rglob("*.py"))
    tests = {path.stem for path in files if path.stem.startswith("test_")}
    for path in files:
        text = path.read_text(encoding="utf-8")
        assert not {word for name in imported(text) for word in name.split(".")} & tests, path
        in_texts = re.findall(r"^\W*(?:from|import) (test_\w+)", text, re.MULTILINE)
        assert not in_texts, f"{path} imports {in_texts}"
