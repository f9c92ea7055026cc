"""The environments' names in Gymnasium's registry, where they stand as soon as both packages are loaded.

`gymnasium.make("nas_data:nas/ErgoReacher-v0")` imports `nas_data` and looks the name up, in worker processes too.
Gymnasium takes longer to load than `nas --help` may, so `nas_data` does not import it: it waits for who does.
"""

import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec
from types import ModuleType

from nas_data import registry

GYMNASIUM = "gymnasium"


def make_environment_name(task: str) -> str:
    """Return a task's name as an environment: `ergo_reacher` → `ErgoReacher`."""
    return "".join(word.capitalize() for word in task.split("_"))


def make_environment_id(task: str) -> str:
    """Return a task's name as Gymnasium registers it: `ergo_reacher` → `nas/ErgoReacher-v0`."""
    return f"nas/{make_environment_name(task)}-v0"


def register_when_loaded() -> None:
    """Register every environment with Gymnasium: at once, or at the end of its import."""
    if GYMNASIUM in sys.modules:
        register()
    else:
        sys.meta_path.insert(0, Finder())


def register() -> None:
    """Register every environment with Gymnasium."""
    import gymnasium

    for task in registry.list_names("envs"):
        gymnasium.register(
            id=make_environment_id(task), entry_point="nas_data.envs.loop.arm_env:ArmEnv", kwargs={"task": task}
        )


class Finder:
    """Finds Gymnasium as Python would, and lets the registration follow its import (see `sys.meta_path`)."""

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return how Gymnasium is loaded; None for every other module."""
        if name != GYMNASIUM:
            return None
        sys.meta_path.remove(self)
        specs = (finder.find_spec(name, path, target) for finder in sys.meta_path)
        spec = next((spec for spec in specs if spec is not None), None)
        if spec is None or spec.loader is None:
            return spec
        load = spec.loader.exec_module

        def load_and_register(module: ModuleType) -> None:
            load(module)
            register()

        spec.loader.exec_module = load_and_register  # type: ignore[method-assign]
        return spec
