"""Import of recorded logs as a dataset: read by a map, audited, aligned, and resampled if the map asks for it."""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from nas_data.dataset.audits.base import AuditFinding
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.derive_provenance import subtasks
from nas_data.dataset.features import (
    ACTION,
    NEXT_STATE,
    STATE,
    TIME,
    Feature,
    make_action_feature,
    make_state_feature,
    make_time_feature,
)
from nas_data.dataset.provenance import Parent, Provenance
from nas_data.dataset.read import read
from nas_data.dataset.recording import Recording
from nas_data.dataset.transitions import NEXT_DERIVED, VELOCITIES_DERIVED, estimate_velocities
from nas_data.dataset.versions import make_parent, resolve
from nas_data.errors import LogError
from nas_data.importing.auditing import allow, audit
from nas_data.importing.conversion import Conversion
from nas_data.importing.formats import find_format, is_folder_log
from nas_data.importing.map import KEPT_VELOCITY, Map
from nas_data.importing.reading import SUFFIXES, read_log, refuse_nothing, report_short
from nas_data.importing.resampling import resample
from nas_data.importing.unwrapping import unwrap as unwrap_turns
from nas_data.joint_units import convert_hinge_unit
from nas_data.recorders.lerobot_features import add_other_features
from nas_data.visible_files import list_visible_files

MAP_ATTACHMENT = "meta/import_map.toml"
MIN_TRANSITION_ROWS = 2  # fewest rows with a transition
VIDEOS = {".mp4", ".mkv"}
ROUNDING = 1e-15  # relative error of a count that was converted and is converted back in float64
COARSEST_STEP = 0.01  # of a signal's range; float32 has steps of 128 s in seconds since 1970, so that they need float64


@dataclass(frozen=True)
class Import:
    """Result of an import.

    Attributes:
        dataset: One episode per recording, with the features of the dataset format.
        provenance: Origin of the dataset, with the findings as notes.
        attachments: Extra files by path: the map.
        findings: Warnings of the audits.
    """

    dataset: Dataset
    provenance: Provenance
    attachments: dict[str, bytes]
    findings: tuple[AuditFinding, ...]


def import_logs(
    paths: Sequence[Path],
    mapping: Map,
    progress: Callable[[str], None] = lambda _: None,
    unwrap: Mapping[str, float] | None = None,
) -> Import:
    """Import logs as a dataset.

    Args:
        paths: Logs, or folders of logs.
        mapping: Map from a log to joints, commands and signals.
        progress: Called with the number and name of each log before it is read.
        unwrap: Middle of the range of joints that have one [rad]; if given, joints whose encoders or commands jump
            after a whole turn are unwrapped. None leaves them.

    Raises:
        LogError: a log cannot be read, or an audit reports an error.
        MapError: the map names a column or topic that a log lacks.
    """
    recordings: list[Recording] = []
    findings: list[AuditFinding] = []
    logs = find_logs(paths, mapping)
    for number, log in enumerate(logs, start=1):
        progress(f"{number}/{len(logs)} {log.name}")
        episodes, left_out = read_log(log, mapping)
        findings += allow(left_out, mapping)
        recordings += episodes
    if unwrap is not None:
        recordings = _unwrap(recordings, mapping, unwrap)
    findings += audit(recordings, mapping)
    raise_audit_errors(findings)
    refuse_nothing(recordings, findings)
    finished = [_finish(recording, mapping) for recording in recordings]
    ready = [whole for whole in finished if len(whole) >= MIN_TRANSITION_ROWS]
    short = [whole for whole in finished if len(whole) < MIN_TRANSITION_ROWS]
    findings += [report_short(whole, " after resampling", MIN_TRANSITION_ROWS) for whole in short]
    refuse_nothing(ready, findings)
    dataset, kept = _convert_recordings(ready, mapping), {}
    if mapping.layout.format == "lerobot":
        kept = subtasks([resolve(log) for log in logs])
        dataset, lost = add_other_features(dataset, ready, mapping)
        findings += lost
    return Import(
        dataset=dataset,
        provenance=_make_provenance(logs, ready, mapping, findings),
        attachments={MAP_ATTACHMENT: mapping.text.encode(), **kept},
        findings=tuple(findings),
    )


def _unwrap(recordings: Sequence[Recording], mapping: Map, centres: Mapping[str, float]) -> list[Recording]:
    """Remove the whole turns by which encoders jump."""
    kinds = dict(zip(mapping.joints, mapping.command.conversion.kinds, strict=True))
    commanded = {joint for joint, kind in kinds.items() if kind == "position"}
    centres = {**centres, **{joint: (low + high) / 2 for joint, (low, high) in mapping.limits.items()}}
    return unwrap_turns(recordings, set(mapping.joints) - mapping.slides, commanded, centres)


def find_logs(paths: Sequence[Path], mapping: Map) -> list[Path]:
    """Expand paths to logs: files, folders of files, or folders that are one log each.

    Raises:
        LogError: a path that does not exist, a folder without a log, or a log named twice.
    """
    logs = [log for path in paths for log in _expand(path, mapping)]
    seen: set[Path] = set()
    for log in logs:
        if log.resolve() in seen:
            raise LogError(f"{log} is given twice; give it once.")
        seen.add(log.resolve())
    return logs


def _expand(path: Path, mapping: Map) -> list[Path]:
    if not path.exists():
        raise LogError(f"There is no log {path}; give recorded files or folders.")
    files = mapping.layout.files
    if files is not None:
        wanted = list(files.values())
        if not path.is_dir() or any((path / name).is_file() for name in wanted):
            return [path]
        logs = [folder for folder in list_visible_files(path) if any((folder / name).is_file() for name in wanted)]
    elif path.is_file() or is_folder_log(path, mapping.layout.format):
        return [path]
    else:
        wanted = list(find_format(mapping.layout.format).SUFFIXES)
        logs = [file for file in list_visible_files(path, mapping.layout.pattern) if file.suffix.lower() in wanted]
    if not logs:
        raise LogError(f"{path} holds no log ({' or '.join(wanted)}), which the map {mapping.name} reads.")
    return logs


def raise_audit_errors(findings: Sequence[AuditFinding]) -> None:
    """Raise the errors among findings.

    Raises:
        LogError: there are errors; the message has the first one, the number of others, and their logs.
    """
    errors = [finding for finding in findings if finding.error]
    if not errors:
        return
    sentence = f"{errors[0].file}: {errors[0].message}"
    if len(errors) > 1:
        files = list(dict.fromkeys(finding.file for finding in errors[1:]))
        shown = ", ".join(files[:5]) + (" …" if len(files) > 5 else "")
        sentence += f" And {len(errors) - 1} more like this (in {shown})."
    raise LogError(sentence)


def _finish(recording: Recording, mapping: Map) -> Recording:
    """Align, resample and derive velocities as specified by the map."""
    signals = dict(recording.signals)
    if mapping.derive_velocity and recording.velocities is not None:
        signals[KEPT_VELOCITY] = recording.velocities
    whole = replace(recording, signals=signals).align(mapping.alignment)
    if mapping.resample:
        whole = resample(whole, mapping.resample)
    if not mapping.derive_velocity:
        return whole
    return replace(whole, velocities=estimate_velocities(whole.positions, mapping.fps))


def _convert_recordings(recordings: Sequence[Recording], mapping: Map) -> Dataset:
    """Convert recordings of N rows to N−1 transitions each."""
    kinds = mapping.command.conversion.kinds
    features = {
        STATE: make_state_feature(mapping.joints, mapping.slides),
        ACTION: make_action_feature(mapping.joints, [SUFFIXES[kind] for kind in kinds], mapping.slides),
        NEXT_STATE: make_state_feature(mapping.joints, mapping.slides),
        TIME: make_time_feature(),
    }
    columns = {
        STATE: [_stack_states(recording)[:-1] for recording in recordings],
        ACTION: [recording.commands[:-1] for recording in recordings],
        NEXT_STATE: [_stack_states(recording)[1:] for recording in recordings],
        TIME: [recording.time[:-1, None] for recording in recordings],
    }
    for name in recordings[0].signals:
        columns[f"nas.{name}"] = [recording.signals[name][:-1] for recording in recordings]
        features[f"nas.{name}"] = _make_signal_feature(name, mapping, np.concatenate(columns[f"nas.{name}"]))
    return Dataset(
        features=features,
        columns={key: np.concatenate(parts).astype(features[key].dtype) for key, parts in columns.items()},
        lengths=np.array([len(recording) - 1 for recording in recordings]),
        fps=mapping.fps,
        robot_type=mapping.robot,
        tasks=tuple(_format_task(recording, mapping) for recording in recordings),
    )


def _stack_states(recording: Recording) -> np.ndarray:
    """Return positions [rad; m] then velocities [rad/s; m/s], shape (N, 2n)."""
    assert recording.velocities is not None
    return np.hstack([recording.positions, recording.velocities])


def _make_signal_feature(name: str, mapping: Map, values: np.ndarray) -> Feature:
    """Describe a signal of N frames: one component a joint, or one for the whole robot; values have shape (N, k)."""
    signal = mapping.signals.get(name, mapping.velocity)
    assert signal is not None
    width = len(signal.conversion.gain)
    names = tuple(f"{joint}.{name}" for joint in mapping.joints) if width == len(mapping.joints) else (name,)
    units = (signal.unit,) * width
    if signal is mapping.velocity:
        units = tuple(convert_hinge_unit(signal.unit, joint in mapping.slides) for joint in mapping.joints)
    return Feature(names, units, "float64" if _needs_double(values, signal.conversion) else "float32")


def _needs_double(values: np.ndarray, conversion: Conversion) -> bool:
    """Whether float32 is too coarse for a signal: it changes counts, or has steps that the signal's range shows.

    Args:
        values: Values of the signal, shape (N, k).
        conversion: Conversion from the log, in which whole numbers are counts.
    """
    raw, sizes = conversion.raw(values), np.abs(values).max(axis=0)
    counts = (np.abs(raw - np.rint(raw)) <= ROUNDING * np.abs(raw)).all(axis=0)
    with np.errstate(over="ignore", invalid="ignore"):
        errors = np.abs(values.astype(np.float32) - values).max(axis=0)
        steps, ranges = np.spacing(sizes.astype(np.float32)), np.ptp(values, axis=0)
    coarse = np.where(counts, errors > np.abs(conversion.gain) / 2, (steps > COARSEST_STEP * ranges) & (ranges > 0))
    return bool(coarse.any())


def _format_task(recording: Recording, mapping: Map) -> str:
    """Return the task of an episode, from the map's template."""
    return mapping.task.format_map({"log": recording.log, **recording.constants})


def _make_provenance(
    logs: Sequence[Path], recordings: Sequence[Recording], mapping: Map, findings: Sequence[AuditFinding]
) -> Provenance:
    """Return the source files, how they were read, and the audits' findings."""
    derived = {key: VELOCITIES_DERIVED for key in (STATE, NEXT_STATE) if mapping.derive_velocity}
    derived[NEXT_STATE] = "; ".join(filter(None, [NEXT_DERIVED, derived.get(NEXT_STATE)]))
    if mapping.resample:
        how = f"resampled from {mapping.rate:g} to {mapping.resample.rate:g} Hz ({mapping.resample.method})"
        derived |= {key: "; ".join(filter(None, [derived.get(key), how])) for key in (STATE, NEXT_STATE)}
        derived[ACTION] = f"held between rows, {how}"
    return Provenance(
        how="imported",
        robot=mapping.robot,
        target={
            "kind": "hardware log",
            "logs": [{"file": log.name, "sha256": _hash_log(log, mapping)} for log in logs],
            "episodes": [
                {"log": recording.log, "task": _format_task(recording, mapping), "constants": dict(recording.constants)}
                for recording in recordings
            ],
        },
        signal={
            "excitation": "recorded",
            "map": mapping.name,
            "alignment": mapping.alignment,
            "conversion": _describe_conversion(mapping),
        },
        parents=tuple(_read_parent(log) for log in logs) if mapping.layout.format == "lerobot" else (),
        derived=derived,
        contiguous=True,
        notes="\n".join(f"{finding.check}: {Path(finding.file).name}: {finding.message}" for finding in findings),
    )


def _describe_conversion(mapping: Map) -> dict[str, dict[str, object]]:
    """Return the raw unit, gain and bias of each joint's positions and commands: SI = gain · raw + bias."""
    quantities = {"position": mapping.position.conversion, "command": mapping.command.conversion}
    return {
        name: {
            joint: {"unit": unit, "gain": float(gain), "bias": float(bias)}
            for joint, unit, gain, bias in zip(mapping.joints, one.units, one.gain, one.bias, strict=True)
        }
        for name, one in quantities.items()
    }


def _read_parent(log: Path) -> Parent:
    """Return the provenance entry of a LeRobot dataset."""
    root = resolve(log)
    return make_parent(root, read(root))


def _hash_log(log: Path, mapping: Map) -> str | dict[str, str]:
    """Return the SHA-256 of a log's file, or of each of its files."""
    if log.is_dir() and mapping.layout.files is None:
        files = sorted(path for path in log.rglob("*") if path.is_file() and path.suffix not in VIDEOS)
        return {path.relative_to(log).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}
    if mapping.layout.files is None:
        return hashlib.sha256(log.read_bytes()).hexdigest()
    return {name: hashlib.sha256((log / name).read_bytes()).hexdigest() for name in mapping.layout.files.values()}
