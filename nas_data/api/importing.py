"""Import of recorded logs of any robot, or of LeRobot datasets in any unit, into memory."""

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from nas_data.api.arguments import Progress
from nas_data.dataset.cutting import cut_every, find_original_episodes
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.derive_provenance import subtasks
from nas_data.dataset.external import name_folder
from nas_data.dataset.origin import Origin
from nas_data.dataset.target_episodes import select_episodes
from nas_data.dataset.versions import resolve
from nas_data.errors import DatasetInvalid, JointMismatch, LogError, OptionError
from nas_data.importing.calibration import find_range_middles, find_side, match_motors
from nas_data.importing.lerobot import (
    BY_OPTIONS,
    CALIBRATION_ATTACHMENT,
    GENERATED,
    ImportOptions,
    complete_map,
    import_dataset,
    is_dataset,
    map_text,
    report_unit_grippers,
)
from nas_data.importing.map import Map
from nas_data.importing.map_file import load_map, parse_map
from nas_data.importing.section import MapSection
from nas_data.log import warn
from nas_data.recorders.logs import Import
from nas_data.recorders.logs import import_logs as import_by_map
from nas_data.runs.progress import silence
from nas_data.simulators.against_model import check as check_against_model
from nas_data.simulators.against_model import find_hinge_centres

LEROBOT = "lerobot"


@dataclass(frozen=True, kw_only=True)
class ImportRequest:
    """Arguments of `import_logs`."""

    logs: tuple[Path, ...]
    map: str | None = None
    unit: str | None = None
    calibration: tuple[Path, ...] = ()
    model: str | None = None
    rate: float | None = None
    uniform: bool = False
    unwrap: bool = False
    cut: float | None = None
    progress: Progress = silence

    @property
    def lerobot_options(self) -> ImportOptions:
        """Options for LeRobot datasets besides a map; positions that are unwrapped without a map are radians."""
        radians = self.unwrap and self.map is None and not self.calibration
        return ImportOptions(self.unit or ("rad" if radians else None), self.calibration, self.rate, self.uniform)

    @property
    def options(self) -> dict[str, object]:
        """The arguments that differ from their defaults, beside the logs, as provenance stores them."""
        given = {
            "map": self.map and Path(self.map).name,
            "unit": self.unit,
            "calibration": [path.name for path in self.calibration],
            "model": self.model and Path(self.model).name,
            "rate": self.rate,
            "uniform": self.uniform,
            "unwrap": self.unwrap,
            "cut": self.cut,
        }
        return {name: value for name, value in given.items() if value}


@dataclass(frozen=True)
class Imported:
    """An imported dataset, with the decisions of the import.

    Attributes:
        result: Dataset, provenance and findings.
        name: Default name of the dataset.
        notes: Decisions of the import, one sentence each.
        mapped: Whether a map defined the columns.
    """

    result: Import
    name: str
    notes: tuple[str, ...]
    mapped: bool


def import_logs(
    logs: str | Path | Sequence[str | Path],
    *,
    map: str | Path | None = None,
    unit: str | None = None,
    calibration: str | Path | Sequence[str | Path] = (),
    model: str | Path | None = None,
    rate: float | None = None,
    uniform: bool = False,
    unwrap: bool = False,
    cut: float | None = None,
    progress: Progress | None = None,
) -> Dataset:
    """Read logs (CSV, Parquet, NPZ, JSON, MCAP, ROS bags) or LeRobot datasets in any unit.

    Recordings are audited: errors raise, warnings go to stderr. `save` writes the dataset and its map.

    Args:
        logs: A log, a folder of logs or a LeRobot dataset; or several.
        map: Mapping file (TOML), or the name of an included one such as `so101_npz`; None for a LeRobot dataset.
        unit: Unit of a LeRobot dataset: `deg`, `range` (−100 … 100, with a calibration) or `rad`.
        calibration: LeRobot's calibration file of the recorded robot, or of each of its arms (`ID_left.json`).
        model: Model of the robot, to check sign and zero of each joint.
        rate: Rows per second [Hz] of a LeRobot dataset; None for its own rate.
        uniform: Treat the rows of a LeRobot dataset as evenly spaced, whatever its time stamps.
        unwrap: Unwrap joints whose encoders or commands jump after a whole turn.
        cut: Cut episodes into segments of this length [s].
        progress: Called with the name of each log.

    Raises:
        LogError: a log cannot be read, or an audit finds an error.
        MapError: the map uses a column or topic that a log lacks.
        JointMismatch: the model lacks a joint of the map.
        DatasetInvalid, OptionError: logs and arguments do not fit together.
    """
    paths = [logs] if isinstance(logs, str | Path) else logs
    request = ImportRequest(
        logs=tuple(Path(path) for path in paths),
        map=None if map is None else str(map),
        unit=unit,
        calibration=tuple(
            Path(path) for path in ([calibration] if isinstance(calibration, str | Path) else calibration)
        ),
        model=None if model is None else str(model),
        rate=rate,
        uniform=uniform,
        unwrap=unwrap,
        cut=cut,
        progress=progress or silence,
    )
    result = read_logs(request).result
    warn(tuple(f"{finding.file}: {finding.message}" for finding in result.findings))
    origin = Origin(result.dataset, result.provenance, result.provenance.derived, attachments=dict(result.attachments))
    return replace(result.dataset, origin=origin)


def read_logs(request: ImportRequest) -> Imported:
    """Import as `import_logs`, and return the decisions as well."""
    if not request.logs:
        raise OptionError("No log is given; run: nas import LOG… --map MAP.toml")
    mapping, notes = find_map(request)
    if mapping is None:
        name = choose_dataset_name(request.logs)
        try:
            dataset, provenance, findings = import_dataset(request.logs[0], request.lerobot_options)
        except (DatasetInvalid, JointMismatch) as error:
            raise name_folder(request.logs[0], error) from None
        result = Import(dataset, provenance, subtasks([resolve(request.logs[0])]), findings)
    else:
        name, result = mapping.robot, import_by_map(request.logs, mapping, request.progress, find_centres(request))
        if request.calibration:
            several = len(request.calibration) > 1
            kept = {
                CALIBRATION_ATTACHMENT.format(f"_{find_side(path)}" if several else ""): path.read_bytes()
                for path in request.calibration
            }
            result = replace(result, attachments={**result.attachments, **kept})
    if mapping is None or mapping.layout.format == LEROBOT:
        result = replace(result, findings=(*result.findings, *report_unit_grippers(result.dataset, mapping)))
    if request.model is not None:
        middles = find_middles(mapping, request.calibration)
        doubts = check_against_model(result.dataset, request.model, middles, result.findings)
        result = replace(result, findings=(*result.findings, *doubts))
    if request.cut is not None:
        cut, provenance = cut_every(result.dataset, request.cut), result.provenance
        parts = find_original_episodes(result.dataset, cut)
        target = select_episodes(provenance.target, parts, result.dataset.n_episodes)
        result = replace(result, dataset=cut, provenance=replace(provenance, target=target))
    signal = {**(result.provenance.signal or {}), "options": request.options, "decisions": list(notes)}
    result = replace(result, provenance=replace(result.provenance, signal=signal))
    return Imported(result, name, notes, mapping is not None)


def find_map(request: ImportRequest) -> tuple[Map | None, tuple[str, ...]]:
    """Return the map completed by the options, and the decisions; no map if values stay unchanged.

    Raises:
        OptionError: the options contradict each other.
    """
    options = request.lerobot_options
    if request.map is None and not options.needs_map:
        return None, ()
    if request.map is None:
        path = request.logs[0]
        check_dataset(path)
        text = map_text(path, options.unit, request.model)
        generated = parse_map(MapSection(tomllib.loads(text), f"the map of {path}"), GENERATED, text)
        mapping = replace(generated, remedies=BY_OPTIONS)
    else:
        mapping = load_map(request.map)
    if mapping.layout.format == LEROBOT:
        return complete_map(mapping, request.logs, options)
    given = next((name for name in ("unit", "calibration", "rate", "uniform") if getattr(request, name)), None)
    if given:
        raise OptionError(f"--{given} is for LeRobot datasets; for logs, set it in the map {request.map}.")
    return mapping, ()


def find_centres(request: ImportRequest) -> dict[str, float] | None:
    """Return the middle of the range of the model's hinges [rad], to unwrap encoders; None if that is not asked for."""
    if not request.unwrap:
        return None
    return find_hinge_centres(request.model) if request.model is not None else {}


def find_middles(mapping: Map | None, calibration: Sequence[Path]) -> dict[str, float]:
    """Return the positions of the middles of calibrated ranges, by joint, for a map of LeRobot datasets."""
    if mapping is None or mapping.layout.format != LEROBOT:
        return {}
    return find_range_middles(mapping, match_motors(mapping, calibration))


def choose_dataset_name(logs: Sequence[Path]) -> str:
    """Return the default name for the import of one LeRobot dataset.

    Raises:
        LogError: the path does not exist.
        OptionError: it is no dataset, or there are several.
    """
    check_dataset(logs[0])
    for log in logs:
        check_exists(log)
    if len(logs) > 1:
        raise OptionError("Import LeRobot datasets one at a time, then join them with nas merge.")
    return logs[0].resolve().name


def check_dataset(path: Path) -> None:
    """Refuse paths that are no LeRobot dataset and therefore need a map.

    Raises:
        LogError: the path does not exist.
        OptionError: the path is no LeRobot dataset.
    """
    check_exists(path)
    if not is_dataset(path):
        raise OptionError(
            f"{path} is not a LeRobot dataset; to import a log, give --map with the meaning of its columns."
        )


def check_exists(path: Path) -> None:
    """Raise LogError if there is no file or folder at a path."""
    if not path.exists():
        raise LogError(f"There is no log {path}; give recorded files or folders, or a LeRobot dataset's folder.")
