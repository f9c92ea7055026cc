"""Turn recorded logs of any robot into a dataset."""

import sys
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from nas_data.commands.base import Command, Outcome
from nas_data.errors import LogError, OptionError

if TYPE_CHECKING:
    from nas_data.dataset.audits.base import Finding
    from nas_data.recorders.logs import Import

PATIENCE = 2.0  # [s] after which progress is shown
SHOWN = 3  # findings of one kind that are printed in full


@dataclass(frozen=True, kw_only=True)
class ImportLogs(Command):
    """Turn recorded logs (CSV, Parquet, NPZ, JSON) of any robot into one dataset, one episode a log.

    Example: nas import recordings/*.npz --map so101_npz --name so101

    The map says where in a log each quantity stands and what its numbers mean; so101_npz, so101_csv and xl330_json
    come with the program, and example_csv explains every key in its comments, to be copied for your own robot.
    Logs are audited first: errors refuse, warnings are kept. A dataset that LeRobot recorded needs no map: velocities
    and next states that it lacks are derived. nas info, pair and gap also take it as it is.
    """

    logs: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="LOG…")]
    """Logs, or folders of logs."""
    map: str | None = None
    """Mapping file (TOML), or the name of a shipped one: so101_npz, so101_csv, xl330_json, example_csv. None for a
    LeRobot dataset."""
    name: str | None = None
    """Dataset's name; the result is the next version below datasets/NAME. The map's robot where left out."""
    out: Path | None = None
    """Exactly this folder instead; must not exist."""

    def run(self) -> Outcome:
        """Read, audit, convert and write."""
        from nas_data.dataset import versions
        from nas_data.importing.map_file import load_map
        from nas_data.recorders.logs import import_logs

        if not self.logs:
            raise OptionError("No log is given; say: nas import LOG… --map MAP.toml")
        if self.map is None:
            return self._take_dataset()
        mapping = load_map(self.map)
        versions.check_place(out=self.out, name=self.name or mapping.robot)
        result = import_logs(self.logs, mapping, _Progress())
        root = versions.save(
            result.dataset,
            result.provenance,
            out=self.out,
            name=self.name or mapping.robot,
            attachments=result.attachments,
        )
        return Outcome(_text(result, root), _data(result, root))

    def _take_dataset(self) -> Outcome:
        """Import one dataset of LeRobot's."""
        from nas_data.dataset import versions
        from nas_data.importing.lerobot import import_dataset, is_dataset

        path = self.logs[0]
        absent = next((log for log in self.logs if not log.exists()), None)
        if absent is not None:
            raise LogError(f"There is no log {absent}; give recorded files or folders, or a LeRobot dataset's folder.")
        if versions.list_versions(path):
            path = versions.resolve(path)
        if not is_dataset(path):
            raise OptionError(f"{path} is no LeRobot dataset; give --map, which says what a log's columns mean.")
        if len(self.logs) > 1:
            raise OptionError("LeRobot datasets are imported one at a time; then join them: nas merge.")
        versions.check_place(out=self.out, name=self.name or path.resolve().name)
        dataset, provenance = import_dataset(path)
        root = versions.save(dataset, provenance, out=self.out, name=self.name or path.resolve().name)
        lines = [f"{dataset.n_episodes} episodes, {dataset.n_frames} transitions at {dataset.fps:g} Hz → {root}"]
        lines += [f"  derived {key}: {how}" for key, how in provenance.derived.items()]
        data = {"dataset": str(root), "robot": dataset.robot_type, "joints": list(dataset.joints), "fps": dataset.fps}
        counts = {"episodes": dataset.n_episodes, "frames": dataset.n_frames, "tasks": list(dataset.tasks)}
        return Outcome("\n".join(lines), {**data, **counts, "derived": dict(provenance.derived), "audit": []})


class _Progress:
    """Says on stderr which log is read, once reading takes long."""

    def __init__(self) -> None:
        self.start = time.monotonic()

    def __call__(self, what: str) -> None:
        if time.monotonic() - self.start > PATIENCE:
            print(f"reading {what}", file=sys.stderr)


def _text(result: "Import", root: Path) -> str:
    """Say what was imported and what the audits noticed."""
    dataset = result.dataset
    minutes = dataset.n_frames / dataset.fps / 60
    lines = [
        f"{dataset.robot_type}: {dataset.n_episodes} episodes, {dataset.n_frames} transitions at {dataset.fps:g} Hz "
        f"({minutes:.1f} min), joints {', '.join(dataset.joints)}.",
        *(_findings_text(result.findings) or ["The audits found nothing."]),
        f"The dataset lies in {root}",
    ]
    return "\n".join(lines)


def _findings_text(findings: "Iterable[Finding]") -> list[str]:
    """List findings by their kind, a few of each."""
    kinds: dict[str, list[Finding]] = {}
    for finding in findings:
        kinds.setdefault(finding.check, []).append(finding)
    lines = []
    for check, members in kinds.items():
        lines.append(f"Warning {check}:")
        lines += [f"  {Path(finding.file).name}: {finding.message}" for finding in members[:SHOWN]]
        if len(members) > SHOWN:
            lines.append(f"  … and {len(members) - SHOWN} more (--json lists all)")
    return lines


def _data(result: "Import", root: Path) -> dict[str, object]:
    """Say the same for machines."""
    dataset = result.dataset
    return {
        "dataset": str(root),
        "robot": dataset.robot_type,
        "joints": list(dataset.joints),
        "fps": dataset.fps,
        "episodes": dataset.n_episodes,
        "frames": dataset.n_frames,
        "tasks": list(dataset.tasks),
        "audit": [finding.to_json() for finding in result.findings],
    }
