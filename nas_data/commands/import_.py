"""Turn recorded logs of any robot into a dataset."""

import sys
import time
import tomllib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from nas_data.commands.base import Command, CommandResult
from nas_data.errors import LogError, OptionError

if TYPE_CHECKING:
    from nas_data.dataset.audits.base import AuditFinding
    from nas_data.importing.lerobot import Said
    from nas_data.importing.map import Map
    from nas_data.recorders.logs import Import

PATIENCE = 2.0  # [s] after which progress is shown
SHOWN = 3  # findings of one kind that are printed in full


@dataclass(frozen=True, kw_only=True)
class ImportLogs(Command):
    """Turn recorded logs (CSV, Parquet, NPZ, JSON) or LeRobot datasets of any robot into one dataset.

    Example: nas import recordings/*.npz --map so101_npz --name so101

    Example: nas import my_recording --map so101_lerobot --calibration my_arm.json

    The map says where in a log each quantity stands and what its numbers mean; so101_npz, so101_csv and xl330_json
    come with the program, so101_lerobot, so100_lerobot and koch_lerobot for what lerobot-record writes (degrees, or
    −100 … 100 with the calibration), and example_csv and example_lerobot explain every key, to be copied for your own
    robot. Recordings are audited first: errors refuse, warnings are kept. A LeRobot dataset in radians needs no map:
    velocities and next states that it lacks are derived. Cameras and task texts are kept.
    """

    logs: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="LOG…")]
    """Logs, folders of logs, or LeRobot datasets."""
    map: str | None = None
    """Mapping file (TOML), or the name of a shipped one such as so101_npz or so101_lerobot. None for a LeRobot dataset
    in radians."""
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
        from dataclasses import replace

        from nas_data.dataset import versions
        from nas_data.dataset.cutting import cut_every

        if not self.logs:
            raise OptionError("No log is given; say: nas import LOG… --map MAP.toml")
        mapping, notes = self._mapping()
        name = self.name or (mapping.robot if mapping else self._dataset_name())
        versions.check_place(out=self.out, name=name)
        result = self._by_map(mapping) if mapping else self._as_it_is()
        findings = result.findings
        if self.model is not None:
            from nas_data.importing.against_model import check

            findings = (*findings, *check(result.dataset, self.model, self._middles(mapping)))
        dataset = result.dataset if self.cut is None else cut_every(result.dataset, self.cut)
        result = replace(result, dataset=dataset, findings=findings)
        root = versions.save(dataset, result.provenance, out=self.out, name=name, attachments=result.attachments)
        text = [*notes, *(f"derived {key}: {how}" for key, how in result.provenance.derived.items() if not mapping)]
        return CommandResult(
            "\n".join([_text(result, root), *(f"  {line}" for line in text)]), _data(result, root, notes)
        )

    def _mapping(self) -> "tuple[Map | None, tuple[str, ...]]":
        """Return the map with what the options say, and what was decided; None where numbers stay as they are."""
        from nas_data.importing.lerobot import is_dataset, map_text, settle
        from nas_data.importing.map_file import load_map, parse_map
        from nas_data.importing.section import MapSection

        if self.map is None and not self._said.needs_map:
            return None, ()
        if self.map is None:
            path = self.logs[0]
            if not is_dataset(path):
                raise OptionError(f"{path} is no LeRobot dataset; give --map, which says what a log's columns mean.")
            text = map_text(path, self.unit, self.model)
            mapping = parse_map(MapSection(tomllib.loads(text), f"the map of {path}"), "generated", text)
        else:
            mapping = load_map(self.map)
        if mapping.layout.format == "lerobot":
            return settle(mapping, self.logs, self._said)
        given = [name for name in ("unit", "calibration", "rate", "uniform") if getattr(self, name)]
        if given:
            raise OptionError(f"--{given[0]} is for LeRobot datasets; say it in the map {self.map} instead.")
        return mapping, ()

    def _middles(self, mapping: "Map | None") -> dict[str, float]:
        """Return where joints are put whose calibrated range is in its middle, of a LeRobot dataset."""
        from nas_data.importing.calibration import middles_of, motors_of, read_calibration

        if mapping is None or mapping.layout.format != "lerobot":
            return {}
        file = self.calibration
        return middles_of(mapping, [] if file is None else motors_of(mapping, read_calibration(file), file))

    @property
    def _said(self) -> "Said":
        from nas_data.importing.lerobot import Said

        return Said(self.unit, self.calibration, self.rate, self.uniform)

    def _by_map(self, mapping: "Map") -> "Import":
        """Import logs by their map."""
        from dataclasses import replace

        from nas_data.importing.lerobot import CALIBRATION_ATTACHMENT
        from nas_data.recorders.logs import import_logs

        result = import_logs(self.logs, mapping, _Progress())
        if self.calibration is None:
            return result
        content = self.calibration.read_bytes()
        return replace(result, attachments={**result.attachments, CALIBRATION_ATTACHMENT: content})

    def _dataset_name(self) -> str:
        """Return the name of what is made of one dataset of LeRobot's.

        Raises:
            LogError: there is nothing.
            OptionError: it is none, or there are several.
        """
        from nas_data.importing.lerobot import is_dataset

        path = self.logs[0]
        absent = next((log for log in self.logs if not log.exists()), None)
        if absent is not None:
            raise LogError(f"There is no log {absent}; give recorded files or folders, or a LeRobot dataset's folder.")
        if not is_dataset(path):
            raise OptionError(f"{path} is no LeRobot dataset; give --map, which says what a log's columns mean.")
        if len(self.logs) > 1:
            raise OptionError("LeRobot datasets are imported one at a time; then join them: nas merge.")
        return path.resolve().name

    def _as_it_is(self) -> "Import":
        """Import one dataset of LeRobot's whose numbers are in SI."""
        from nas_data.importing.lerobot import import_dataset
        from nas_data.recorders.logs import Import

        dataset, provenance, findings = import_dataset(self.logs[0], self._said)
        return Import(dataset, provenance, {}, findings)


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


def _findings_text(findings: "Iterable[AuditFinding]") -> list[str]:
    """List findings by their kind, a few of each."""
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


def _data(result: "Import", root: Path, notes: Sequence[str]) -> dict[str, object]:
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
        "derived": dict(result.provenance.derived),
        "notes": list(notes),
        "audit": [finding.to_json() for finding in result.findings],
    }
