"""Turn recorded logs of any robot into a dataset."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from nas_data.commands.base import Command, CommandResult
from nas_data.count_of import count_of
from nas_data.runs.progress import PAUSE, RateLimited, say

if TYPE_CHECKING:
    from nas_data.dataset.audits.base import AuditFinding
    from nas_data.recorders.logs import Import

SHOWN = 3  # findings of one kind that are printed in full


@dataclass(frozen=True, kw_only=True)
class ImportLogs(Command):
    """Turn recorded logs (tables, arrays, bags) or LeRobot datasets of any robot into one dataset.

    Example: nas import recordings/*.npz --map so101_npz --name so101

    Example: nas import my_recording --map so101_lerobot --calibration my_arm.json

    The map says where in a log each quantity stands and what its numbers mean; so101_npz, so101_csv and xl330_json
    come with the program, so101_lerobot, so100_lerobot and koch_lerobot for what lerobot-record writes (degrees, or
    −100 … 100 with the calibration), and example_csv, example_ros2 and example_lerobot explain every key, to be copied
    for your own robot. Recordings are audited first: errors refuse, warnings are kept. A LeRobot dataset needs no map
    if its joints are called, signed and zeroed as in the model: --unit says what its numbers are. Velocities and next
    states that it lacks are derived. Cameras and task texts are kept.
    """

    logs: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="LOG…")]
    """Logs, folders of logs, or LeRobot datasets."""
    map: str | None = None
    """Mapping file (TOML), or the name of a shipped one such as so101_npz or so101_lerobot. Logs need one; a LeRobot
    dataset may do without."""
    unit: str | None = None
    """Unit of a LeRobot dataset: deg, range (−100 … 100, with --calibration) or rad. Told by the readings where a map
    is given and this is not; without a map, every joint is in this unit."""
    calibration: Path | None = None
    """LeRobot's calibration file of the robot that recorded, a JSON file; −100 … 100 mean nothing without it."""
    model: str | None = None
    """A model of the robot, to check sign and zero of each joint against its limits and its gravity, and for the range
    of a gripper where there is no map."""
    rate: float | None = None
    """Rows a second [Hz] of a LeRobot dataset, in place of its own fps."""
    uniform: bool = False
    """Take the rows of a LeRobot dataset as evenly spaced, whatever its time stamps say."""
    cut: float | None = None
    """Cut episodes into stretches of so many seconds, such as 3."""
    name: str | None = None
    """Dataset's name; the result is the next version below datasets/NAME. The map's robot where left out."""
    out: Path | None = None
    """Exactly this folder instead; must not exist."""

    def run(self) -> CommandResult:
        """Read, audit, convert and write."""
        from nas_data.api.importing import ImportRequest, read_logs
        from nas_data.dataset import versions

        versions.check_destination(out=self.out, name=self.name or "dataset")
        request = ImportRequest(
            logs=self.logs,
            map=self.map,
            unit=self.unit,
            calibration=self.calibration,
            model=self.model,
            rate=self.rate,
            uniform=self.uniform,
            cut=self.cut,
            progress=RateLimited(lambda what: say(f"reading {what}"), first=PAUSE),
        )
        imported = read_logs(request)
        result, name = imported.result, self.name or imported.name
        root = versions.save(result.dataset, result.provenance, out=self.out, name=name, attachments=result.attachments)
        derived = () if imported.mapped else result.provenance.derived.items()
        lines = [*imported.notes, *(f"derived {key}: {how}" for key, how in derived)]
        text = "\n".join([_format_result(result, root), *(f"  {line}" for line in lines)])
        return CommandResult(text, _make_json(result, root, imported.notes))


def _format_result(result: "Import", root: Path) -> str:
    """Return the result and the findings of the audits as text."""
    dataset = result.dataset
    minutes = dataset.n_frames / dataset.fps / 60
    lines = [
        f"{dataset.robot_type}: {count_of(dataset.n_episodes, 'episode')}, {count_of(dataset.n_frames, 'transition')} "
        f"at {dataset.fps:g} Hz "
        f"({minutes:.1f} min), joints {', '.join(dataset.joints)}.",
        *(_format_findings(result.findings) or ["The audits found nothing."]),
        f"The dataset lies in {root}",
    ]
    return "\n".join(lines)


def _format_findings(findings: "Iterable[AuditFinding]") -> list[str]:
    """Return the first few findings of each kind as lines."""
    kinds: dict[str, list[AuditFinding]] = {}
    for finding in findings:
        kinds.setdefault(finding.check, []).append(finding)
    lines = []
    for check, members in kinds.items():
        lines.append(f"Warning {check}:")
        lines += [f"  {Path(finding.file).name}: {finding.message}" for finding in members[:SHOWN]]
        if len(members) > SHOWN:
            lines.append(f"  … and {len(members) - SHOWN} more (--json lists all)")
    return lines


def _make_json(result: "Import", root: Path, notes: Sequence[str]) -> dict[str, object]:
    """Return the result for JSON."""
    dataset = result.dataset
    return {
        "dataset": str(root),
        "robot": dataset.robot_type,
        "joints": list(dataset.joints),
        "fps": dataset.fps,
        "episodes": dataset.n_episodes,
        "frames": dataset.n_frames,
        "tasks": list(dataset.tasks),
        "derived": dict(result.provenance.derived),
        "notes": list(notes),
        "audit": [finding.to_json() for finding in result.findings],
    }
