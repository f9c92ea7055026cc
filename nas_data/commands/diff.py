"""Compare two datasets: features, episodes, values, provenance."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from nas_data.commands.base import Command, CommandResult
from nas_data.count_of import count_of
from nas_data.runs.progress import begin

if TYPE_CHECKING:
    from nas_data.dataset.diff import Difference

SHOWN = 5  # episodes listed in full
LONGEST = 60  # most characters of a value


@dataclass(frozen=True, kw_only=True)
class Diff(Command):
    """Show the differences between two datasets; episodes are matched by content, whatever their order.

    Exit code: 0 if the content is equal (provenance may differ), 1 if not.

    Example: nas diff datasets/arm/v1-1a2b3c4d datasets/arm
    """

    a: tyro.conf.Positional[Path]
    """First dataset: a folder, or datasets/NAME for its newest version."""
    b: tyro.conf.Positional[Path]
    """Second dataset."""

    def run(self) -> CommandResult:
        """Read both datasets and compare them."""
        from nas_data.dataset.derive_provenance import Original
        from nas_data.dataset.diff import compare_datasets

        begin(f"comparing {self.a} and {self.b}")
        a, b = Original.read(self.a), Original.read(self.b)
        found = compare_datasets(a.dataset, b.dataset, (a.provenance, b.provenance))
        verdict = "have equal content" if found.equal_content else "differ"
        origins = [
            f"  provenance {key}: {shorten(a)} in A, {shorten(b)} in B" for key, (a, b) in found.provenance.items()
        ]
        lines = [f"A {a.root} and", f"B {b.root} {verdict}.", *describe_content(found), *origins]
        return CommandResult("\n".join(lines), {"a": a.root, "b": b.root, **found.to_json()}, found.equal_content)


def describe_content(found: "Difference") -> Iterator[str]:
    """Yield the differences in content, one sentence each."""
    for what, pair in (("feature", found.only), ("joint", found.joints)):
        for side, names in zip("AB", pair, strict=True):
            yield from (f"  {what} only in {side}: {name}" for name in names)
    for key, (a, b) in found.changed.items():
        yield f"  feature {key}: {a} in A, {b} in B"
    if found.rates:
        yield f"  rate: {found.rates[0]:g} Hz in A, {found.rates[1]:g} Hz in B"
    if found.robots:
        yield f"  robot: {found.robots[0]} in A, {found.robots[1]} in B"
    moved = f", {found.moved} of them at another position" if found.moved else ""
    yield f"  episodes: {found.counts[0]} in A, {found.counts[1]} in B; {found.equal_episodes} equal{moved}"
    for side, episodes in zip("AB", found.unmatched, strict=True):
        if episodes:
            yield f"  episodes only in {side}: {list_first(episodes)}"
    if found.compared:
        yield f"  episodes with other values (A/B): {list_first([f'{i}/{j}' for i, j in found.compared])}"
    for key, change in found.values.items():
        yield (
            f"  {key}: differs in {count_of(change.frames, 'frame')}, at most by {change.largest:.6g} "
            f"{change.unit}".rstrip()
            + f" ({change.component}, episode {change.episodes[0]}/{change.episodes[1]}, frame {change.frame})"
        )
    yield from (f"  task of episode {i}/{j}: '{a}' in A, '{b}' in B" for i, j, a, b in found.tasks[:SHOWN])
    if len(found.tasks) > SHOWN:
        yield f"  … and {len(found.tasks) - SHOWN} more tasks (--json lists all)"
    for i, j, frames, first in found.frame_tasks[:SHOWN]:
        yield f"  tasks of episode {i}/{j}: differ in {count_of(frames, 'frame')}, first in frame {first}"
    if len(found.frame_tasks) > SHOWN:
        yield f"  … and {len(found.frame_tasks) - SHOWN} more episodes with tasks in other frames (--json lists all)"


def list_first(items: tuple[int, ...] | list[str]) -> str:
    """List the first few items."""
    rest = len(items) - SHOWN
    return ", ".join(str(item) for item in items[:SHOWN]) + (f" and {rest} more" if rest > 0 else "")


def shorten(value: object) -> str:
    """Shorten a value for the text output; --json has all of it."""
    text = "none" if value is None else " ".join(str(value).split())
    return text if len(text) <= LONGEST else f"{text[:LONGEST]}…"
