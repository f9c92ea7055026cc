"""Show the contents of a dataset: joints, ranges, rate, episodes, pairing, provenance."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from nas_data.commands.base import Command, CommandResult
from nas_data.errors import DatasetNotFound

if TYPE_CHECKING:
    from nas_data.dataset.summary import DatasetSummary


@dataclass(frozen=True, kw_only=True)
class Info(Command):
    """Show the contents of a dataset, and what must be derived before use.

    Example: nas info datasets/ergojr_sample
    """

    dataset: tyro.conf.Positional[Path]
    """Folder of the dataset, or datasets/NAME for its newest version; any LeRobot v3 dataset works."""

    def run(self) -> CommandResult:
        """Read the dataset and describe it."""
        from nas_data.dataset.summary import summarize

        if self.dataset.is_file():
            raise DatasetNotFound(f"{self.dataset} is a file, not a dataset; give a dataset's folder or datasets/NAME.")
        summary = summarize(self.dataset)
        lines = [*describe_recording(summary), *describe_features(summary), *describe_provenance(summary)]
        return CommandResult("\n".join(lines), summary.to_json())


def describe_recording(summary: "DatasetSummary") -> Iterator[str]:
    """Describe the recorded episodes."""
    frames = sum(summary.lengths)
    tasks = [f"{task or 'unnamed'} ({count})" for task, count in summary.tasks.items()]
    yield f"{summary.name}  ({summary.dataset})"
    yield f"  robot         {summary.robot}"
    yield f"  joints        {', '.join(summary.joints) or 'unknown'}"
    yield f"  commands      {summary.commands or 'unknown'}"
    yield f"  rate          {summary.rate:g} Hz"
    spread = " to ".join(str(length) for length in sorted({min(summary.lengths), max(summary.lengths)}))
    yield f"  episodes      {len(summary.lengths)} of {spread} frames"
    yield f"  frames        {frames}, {frames / summary.rate:.1f} s"
    yield f"  tasks         {', '.join(tasks)}"
    yield f"  paired        {describe_pairing(summary)}"
    yield f"  content hash  {summary.content_hash}"


def describe_features(summary: "DatasetSummary") -> Iterator[str]:
    """Describe the features and the range of each component of state and command."""
    yield "features"
    for key, feature in summary.features.items():
        units = ", ".join(dict.fromkeys(feature.units)) or "no unit stored"
        yield f"  {key}: {feature.width} × {feature.dtype} [{units}]"
    for key, kind in summary.carried.items():
        yield f"  {key}: {kind}, kept unchanged"
    yield "ranges"
    for key, ranges in summary.ranges.items():
        for name, (low, high) in ranges.items():
            yield f"  {key} {name}: {low:.4g} … {high:.4g} {summary.units.get(name, '')}".rstrip()


def describe_provenance(summary: "DatasetSummary") -> Iterator[str]:
    """Describe what must be derived and where the dataset comes from."""
    if summary.unusable:
        yield f"not usable as it is: {summary.unusable}"
    for warning in summary.warnings:
        yield f"warning: {warning}"
    for key, how in summary.derived.items():
        yield f"derived when used: {key}: {how}"
    if not summary.provenance:
        yield "provenance: none (recorded or edited by LeRobot's own tools)"
    for name, provenance in summary.provenance:
        parents = ", ".join(parent.name for parent in provenance.parents)
        yield f"provenance: {name}: {provenance.how}, {provenance.when}" + (f", from {parents}" if parents else "")


def describe_pairing(summary: "DatasetSummary") -> str:
    """Describe whether the dataset is paired, and with which source."""
    from nas_data.dataset.summary import describe_source

    if not summary.paired:
        return "no (nas pair adds the predictions of a source model)"
    return f"yes, with {describe_source(summary.source) or 'an unknown source'}"
