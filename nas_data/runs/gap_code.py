"""The modules that decide what `nas gap` says of a recording, for `code_hash`."""

from nas_data import registry


def gap_modules() -> tuple[str, ...]:
    """Return the workflow, every effect that it may name, and every audit of recordings."""
    return ("nas_data.gap.workflow", *effect_modules(), *files("gap.finding.audits"))


def effect_modules() -> tuple[str, ...]:
    """Return every effect of the catalogue."""
    return files("effects")


def files(folder: str) -> tuple[str, ...]:
    """Return the modules of a plug-in folder."""
    return tuple(f"nas_data.{folder}.{name}" for name in registry.names(folder))
