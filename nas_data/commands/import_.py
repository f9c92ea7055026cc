"""Turn recorded logs of any robot into a dataset."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from nas_data.commands.base import Command, CommandResult
from nas_data.count_of import count_of
from nas_data.runs.progress import PAUSE, RateLimited, begin, format_duration, say

if TYPE_CHECKING:
    from nas_data.api.importing import ImportRequest
    from nas_data.dataset.audits.base import AuditFinding
    from nas_data.recorders.logs import Import

SHOWN = 3  # most printed findings of one kind


@dataclass(frozen=True, kw_only=True)
class ImportLogs(Command):
    """Turn recorded logs (tables, arrays, bags) or LeRobot datasets of any robot into one dataset.

    Example: nas import recordings/*.npz --map so101_npz --name so101

    Example: nas import my_recording --map so101_lerobot --calibration my_arm.json

    The map defines column, unit and sign of each quantity in a log. Included maps: so101_npz, so101_csv, xl330_json;
    so101_lerobot, so100_lerobot and koch_lerobot for lerobot-record (degrees, or −100 … 100 with the calibration);
    example_csv, example_ros2 and example_lerobot, which explain every key, as templates. Recordings are audited first:
    errors abort the import, warnings are stored. A LeRobot dataset needs no map if names, signs and zeros of its joints
    are those of the model: --unit gives the unit. Missing velocities and next states are derived. Cameras and task
    texts are kept.
    """

    logs: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="LOG…")]
    """Logs, folders of logs, or LeRobot datasets."""
    map: str | None = None
    """Mapping file (TOML), or the name of an included one such as so101_npz or so101_lerobot. Logs need one; a LeRobot
    dataset may do without."""
    unit: str | None = None
    """Unit of a LeRobot dataset: deg, range (−100 … 100, with --calibration) or rad. With a map it is inferred from the
    readings by default; without a map, every joint has this unit, but joints with gripper in their name have 0 … 100 of
    their range unless the unit is rad."""
    calibration: Annotated[tuple[Path, ...], tyro.conf.UseAppendAction] = ()
    """LeRobot's calibration file (JSON) of the recorded robot; needed only to convert −100 … 100. Of a robot with two
    arms, give both files: --calibration ID_left.json --calibration ID_right.json."""
    model: str | None = None
    """Model of the robot, to check sign and zero of each joint against limits and gravity. Without a map, it also gives
    the range of a gripper."""
    rate: float | None = None
    """Rows per second [Hz] of a LeRobot dataset; its own fps by default."""
    uniform: bool = False
    """Treat the rows of a LeRobot dataset as evenly spaced, whatever their timestamps."""
    unwrap: bool = False
    """Unwrap joints whose encoders or commands jump after a whole turn, such as from 180° to −180°."""
    cut: float | None = None
    """Cut episodes into segments of this length [s], such as 3; they stay whole by default."""
    name: str | None = None
    """Name of the dataset; the result is the next version below datasets/NAME. Default: the map's robot."""
    out: Path | None = None
    """Write to exactly this folder, which must not exist, instead of a version of datasets/NAME."""

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
            unwrap=self.unwrap,
            cut=self.cut,
            progress=RateLimited(lambda what: say(f"reading {what}"), first=PAUSE),
        )
        if self.name is None and self.out is None:
            _check_default_name(request)
        begin(f"reading and checking {count_of(len(self.logs), 'log')}")
        imported = read_logs(request)
        result, name = imported.result, self.name or imported.name
        begin("writing the dataset")
        root = versions.save(result.dataset, result.provenance, out=self.out, name=name, attachments=result.attachments)
        derived = () if imported.mapped else result.provenance.derived.items()
        lines = [*imported.notes, *versions.describe_older(root), *(f"derived {key}: {how}" for key, how in derived)]
        text = "\n".join([_format_result(result, root), *(f"  {line}" for line in lines)])
        return CommandResult(text, _make_json(result, root, imported.notes))


def _check_default_name(request: "ImportRequest") -> None:
    """Refuse a robot or folder whose name cannot be that of a dataset, before logs are read."""
    from nas_data.dataset.info import DatasetInfo
    from nas_data.dataset.versions import check_name, resolve
    from nas_data.errors import OptionError
    from nas_data.importing.lerobot import is_dataset
    from nas_data.importing.map_file import load_map

    if request.map is not None:
        owner, name = f"the robot of {request.map}", load_map(request.map).robot
    elif len(request.logs) != 1 or not is_dataset(request.logs[0]):
        return  # reading explains what is wrong
    elif request.lerobot_options.needs_map:
        owner, name = (
            f"the robot of {request.logs[0]}",
            DatasetInfo.read(resolve(request.logs[0])).robot_type or "unknown",
        )
    else:
        owner, name = str(request.logs[0]), request.logs[0].resolve().name
    try:
        check_name(name)
    except OptionError as error:
        raise OptionError(f"The name of {owner} would be the dataset's: {error} Give another with --name.") from None


def _format_result(result: "Import", root: Path) -> str:
    """Format the result and the findings of the audits."""
    dataset = result.dataset
    lines = [
        f"{dataset.robot_type}: {count_of(dataset.n_episodes, 'episode')}, {count_of(dataset.n_frames, 'transition')} "
        f"at {dataset.fps:g} Hz "
        f"({format_duration(dataset.n_frames / dataset.fps)}), joints {', '.join(dataset.joints)}.",
        *(_format_findings(result.findings) or ["The audits found no problem."]),
        f"The dataset is in {root}",
    ]
    return "\n".join(lines)


def _format_findings(findings: "Iterable[AuditFinding]") -> list[str]:
    """Format the first few findings of each kind."""
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
