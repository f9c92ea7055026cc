"""Show the catalogue of physical effects: meaning, parameters, signature, and what each is confused with."""

import inspect
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import tyro

from nas_data.commands.base import Command, CommandResult

if TYPE_CHECKING:
    from nas_data.effects.base import Effect, Parameter

WIDTH = 17  # of the longest parameter name


@dataclass(frozen=True, kw_only=True)
class Effects(Command):
    """Show the effects that `nas gap` names and adds, and that `nas record sim` can add to a target.

    Example: nas effects

    Example: nas effects backlash command_delay
    """

    names: Annotated[tuple[str, ...], tyro.conf.Positional, tyro.conf.arg(metavar="[NAME…]")] = ()
    """Effects to show in full; by default all, in short."""

    def run(self) -> CommandResult:
        """Collect and print the effects."""
        from nas_data import registry
        from nas_data.effects.base import find_effect

        chosen = [find_effect(name) for name in self.names or registry.list_names("effects")]
        if self.names:
            text = "\n\n".join("\n".join(describe_effect(kind)) for kind in chosen)
        else:
            width = max(len(kind.name()) for kind in chosen)
            text = "\n".join([*(summarise_effect(kind, width) for kind in chosen), "In full: nas effects NAME"])
        return CommandResult(text, {"effects": [make_json(kind) for kind in chosen]})


def summarise_effect(kind: "type[Effect]", width: int) -> str:
    """Return one line: name, padded to a width, possible joints, parameters."""
    parameters = ", ".join(f"{p.name} [{p.unit}]" if p.unit else p.name for p in kind.parameters)
    line = f"{kind.name():<{width}} {' or '.join(list_places(kind)):<12} {parameters}"
    return line if is_searched(kind) else f"{line} (not searched by nas gap)"


def describe_effect(kind: "type[Effect]") -> Iterator[str]:
    """Yield the full description of an effect, line by line."""
    beyond = "with elements of its own; where these do not fit the joint, as the nearest effect that does"
    entries = {
        "equation": kind.equation,
        **{parameter.name: describe_bounds(parameter) for parameter in kind.parameters},
        "signature": kind.signature,
        "confused with": ", ".join(kind.confused_with) or "none known",
        "searched": "by nas gap" if is_searched(kind) else "no; --effect and --effects add it",
        "in model.xml": "yes" if kind.in_model else beyond,
        "source": kind.source,
    }
    yield f"{kind.name()} ({' or '.join(list_places(kind))}): {read_meaning(kind)}"
    yield from (f"  {name:<{WIDTH}} {what}" for name, what in entries.items())


def describe_bounds(parameter: "Parameter") -> str:
    """Return a parameter's bounds, unit and neutral value."""
    return f"{parameter.low:g} … {parameter.high:g} {parameter.unit}".rstrip() + f", neutral at {parameter.neutral:g}"


def is_searched(kind: "type[Effect]") -> bool:
    """Return whether `nas gap` searches for an effect: whether it has initial guesses."""
    from nas_data.effects.base import Effect

    return kind.guesses.__func__ is not Effect.guesses.__func__  # type: ignore[attr-defined]  # of classmethods


def list_places(kind: "type[Effect]") -> list[str]:
    """Return where an effect can act: in a joint, on a link, on the whole arm."""
    return ["joint"] * kind.per_joint + ["link"] * kind.per_link + ["arm"] * kind.whole_arm


def read_meaning(kind: "type[Effect]") -> str:
    """Return the summary line of an effect."""
    return (inspect.getdoc(kind) or "").split("\n\n")[0].replace("\n", " ")


def make_json(kind: "type[Effect]") -> dict[str, object]:
    """Return an effect for JSON."""
    limits = ("name", "unit", "low", "high", "neutral")
    return {
        "effect": kind.name(),
        "meaning": read_meaning(kind),
        "places": list_places(kind),
        "parameters": [{key: getattr(parameter, key) for key in limits} for parameter in kind.parameters],
        "equation": kind.equation,
        "signature": kind.signature,
        "confused_with": list(kind.confused_with),
        "searched": is_searched(kind),
        "in_model": kind.in_model,
        "source": kind.source,
    }
