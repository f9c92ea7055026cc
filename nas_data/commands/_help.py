"""How the help shows a command's options: type, meaning and default of each, without tyro's `{None}|INT`."""

import ast
import inspect
import itertools
import textwrap
from dataclasses import fields, is_dataclass
from pathlib import Path
from types import NoneType
from typing import TYPE_CHECKING, Annotated, Literal, TypeVar, get_args, get_origin, get_type_hints

import tyro

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

TYPES = {int: "INT", float: "FLOAT", str: "STR", Path: "PATH"}
NO_DEFAULT = {"None", "False", "True", "", "''"}  # defaults of which the option's description says what they mean


Options = TypeVar("Options", bound="DataclassInstance")


def describe_options(kind: type[Options]) -> type[Options]:
    """Return a subclass of a dataclass of options that tyro describes in our words.

    Args:
        kind: Its fields, and the options of fields that are such dataclasses, get metavar, help and default.
    """
    hints, texts = get_type_hints(kind, include_extras=True), read_field_docstrings(kind)
    described = {field.name: describe(field.name, hints[field.name], texts.get(field.name)) for field in fields(kind)}
    return type(
        kind.__name__, (kind,), {"__doc__": kind.__doc__, "__module__": kind.__module__, "__annotations__": described}
    )


def describe(name: str, hint: object, text: str | None) -> object:
    """Return the type of an option with metavar, help and default, except those that it already states."""
    inner, *stated = get_args(hint) if get_origin(hint) is Annotated else (hint,)
    if isinstance(inner, type) and is_dataclass(inner):
        return Annotated[describe_options(inner), tyro.conf.arg(help=text), *stated]
    if tyro.conf.Positional in stated:
        metavar: str | None = name.upper()
    else:
        metavar = name_type(get_args(inner)[0] if tyro.conf.UseAppendAction in stated else inner)
    return Annotated[inner, tyro.conf.arg(metavar=metavar, help=text, help_behavior_hint=format_default), *stated]


def name_type(hint: object) -> str | None:
    """Return how the help shows a type; None for a flag."""
    if hint is bool:
        return None
    if isinstance(hint, type) and hint in TYPES:
        return TYPES[hint]
    choices = get_args(hint)
    if get_origin(hint) is Literal:
        return f"{{{','.join(choices)}}}"
    if choices[-1] is Ellipsis:
        return f"{name_type(choices[0])}…"
    return " ".join(str(name_type(choice)) for choice in choices if choice is not NoneType)


def format_default(default: str) -> str:
    """Return the note of an option's default."""
    return "" if default in NO_DEFAULT else f"(default: {default})"


def read_field_docstrings(kind: type) -> dict[str, str]:
    """Return the docstring below each field of a dataclass and its bases, as one line."""
    texts = dict[str, str]()
    for base in reversed([base for base in kind.__mro__ if is_dataclass(base)]):
        try:
            (definition,) = ast.parse(textwrap.dedent(inspect.getsource(base))).body
        except OSError:  # installed without sources: the options work, and have no description
            continue
        body = definition.body if isinstance(definition, ast.ClassDef) else []
        for field, below in itertools.pairwise(body):
            match field, below:
                case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(value=ast.Constant(value=str(text))):
                    texts[name] = " ".join(text.split())
    return texts
