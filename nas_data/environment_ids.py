"""Registration of the environments with Gymnasium as soon as both packages are imported.

`gymnasium.make("nas_data:nas/ErgoReacher-v0")` imports `nas_data` first, in worker processes too. Importing Gymnasium
takes longer than `nas --help` may, so registration waits until some other code imports it.
"""

import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec
from types import ModuleType

from nas_data import registry

GYMNASIUM = "gymnasium"
TARGET_DYNAMICS = "backlash"  # dynamics of the target unless others are named


def make_environment_name(task: str) -> str:
    """Return the environment name of a task: `ergo_reacher` → `ErgoReacher`."""
    return registry.to_camel_case(task)


def make_environment_id(task: str) -> str:
    """Return the Gymnasium ID of a task: `ergo_reacher` → `nas/ErgoReacher-v0`."""
    return f"nas/{make_environment_name(task)}-v0"


def register_when_loaded() -> None:
    """Register every environment with Gymnasium: immediately, or after its import."""
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
    """Import hook (see `sys.meta_path`) that registers the environments after Gymnasium's import."""

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return Gymnasium's module spec with registration added to its loader; None for other modules."""
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
