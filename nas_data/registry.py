"""The folder is the registry: each file of a plug-in folder defines one object under the file's name."""

import importlib
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import TypeVar

from nas_data.errors import PluginInvalid, UnknownName
from nas_data.visible_files import list_visible_files

ROOT = Path(__file__).parent
T = TypeVar("T")


@cache
def list_names(folder: str) -> tuple[str, ...]:
    """Return the names in a plug-in folder, for example every effect of `effects/`."""
    files = list_visible_files(ROOT.joinpath(*folder.split(".")), "*.py")
    return tuple(path.stem for path in files if path.stem not in {"__init__", "base"})


def import_plugin(folder: str, name: str, kind: str, constant: str = "") -> ModuleType:
    """Import a plug-in by its name.

    Args:
        folder: Plug-in folder, for example `effects`.
        name: File name without `.py`.
        kind: Word for the plug-in in errors, for example `effect`.
        constant: Name of the constant that the file has to define; empty for none.

    Raises:
        UnknownName: the folder has no such file; lists its files.
        PluginInvalid: the file does not define the constant.
    """
    if name not in list_names(folder):
        raise UnknownName(kind, name, list_names(folder))
    found = importlib.import_module(f"nas_data.{folder}.{name}")
    if constant and not hasattr(found, constant):
        raise PluginInvalid(f"{found.__file__} does not define {constant}; write {constant} = … at its end.")
    return found


def find_plugin(folder: str, name: str, kind: str, base: type[T]) -> type[T]:
    """Return the class of a plug-in: from its file, or a loaded class of the user.

    Args:
        folder: Plug-in folder, for example `effects`.
        name: File name without `.py`; `cable_pull` for a user's class `CablePull`.
        kind: Word for the plug-in in errors, for example `effect`.
        base: Base class.

    Raises:
        UnknownName: there is neither; lists the names of the folder.
        PluginInvalid: the file has no class of that name.
    """
    if name not in list_names(folder) and (
        own := [sub for sub in iterate_subclasses(base) if to_snake_case(sub.__name__) == name]
    ):
        return own[-1]
    found = import_plugin(folder, name, kind)
    for value in vars(found).values():
        if isinstance(value, type) and issubclass(value, base) and to_snake_case(value.__name__) == name:
            return value
    wanted = f"class {to_camel_case(name)}({base.__name__})"
    raise PluginInvalid(f"{found.__file__} does not define the {kind} '{name}'; write it as {wanted}.")


def iterate_subclasses(base: type[T]) -> Iterator[type[T]]:
    """Yield the loaded subclasses of a class in order of definition."""
    for kind in base.__subclasses__():
        yield kind
        yield from iterate_subclasses(kind)


@cache
def to_snake_case(name: str) -> str:
    """Return a class's file name: `CommandDelay` → `command_delay`."""
    return re.sub(r"(?<!^)(?=[A-Z])", "_", name).lower()


def to_camel_case(name: str) -> str:
    """Return the name of a file's class: `command_delay` → `CommandDelay`."""
    return "".join(word.capitalize() for word in name.split("_"))


def find_value(folder: str, name: str, kind: str, wanted: type[T]) -> T:
    """Return the object of type `wanted` that a plug-in's file defines.

    Raises:
        UnknownName: the folder has no such file; lists its files.
    """
    return next(value for value in vars(import_plugin(folder, name, kind)).values() if isinstance(value, wanted))
