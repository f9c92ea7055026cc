"""Import of LeRobot datasets: by a map, or unchanged if they are in SI units."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from nas_data.dataset.audits import audit_dataset
from nas_data.dataset.audits.base import AuditFinding, Remedies
from nas_data.dataset.cutting import cut_at, find_gaps
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.descriptions import describe_left_out
from nas_data.dataset.external import import_command, is_ours, refuse, refuse_unknown_unit, report_single_frames
from nas_data.dataset.features import STATE, TIME, VELOCITY, Feature
from nas_data.dataset.info import DatasetInfo
from nas_data.dataset.joints import REMEDY, Components, is_gripper
from nas_data.dataset.passthrough import VIDEO_LEFT_OUT
from nas_data.dataset.provenance import Provenance, read_provenance
from nas_data.dataset.read import read, read_stamps, with_clock
from nas_data.dataset.rows import format_rows
from nas_data.dataset.transitions import as_transitions
from nas_data.dataset.versions import make_parent, resolve
from nas_data.errors import DatasetInvalid, LogError, OptionError
from nas_data.importing.calibration import LARGEST, UNITS, choose_unit, match_motors, with_raw_unit
from nas_data.importing.conversion import NORMALISED
from nas_data.importing.formats import find_folder_kind, is_folder_log
from nas_data.importing.lerobot_velocities import GENERATED, complete_velocity, derive_missing_velocity, read_datasets
from nas_data.importing.map import Map, TimeColumn
from nas_data.importing.reading import refuse_nothing

TIMING = {
    "rate": "use --rate {rate} if the time stamps are right, or --uniform if the dataset's fps is right",
    "repeated_time": "use --uniform to treat the rows as evenly spaced",
    "time_backwards": "use --uniform to treat the rows as evenly spaced",
    "irregular_time": "use --uniform if only the time stamps are uneven",
}
RESAMPLED = {check: f"{TIMING[check]}, or add [resample] to the map" for check in ("rate", "irregular_time")}
BY_OPTIONS = Remedies(TIMING, "in a map of your own (--map)")
BY_OPTIONS_OR_MAP = Remedies(TIMING | RESAMPLED)

OPEN = 0.9  # share of its range to which an open gripper is open at least
SAME_RATE = 1e-6  # relative
CALIBRATION_ATTACHMENT = "meta/calibration{}.json"  # of one arm, or of each with its side


@dataclass(frozen=True)
class ImportOptions:
    """Options for the import of LeRobot datasets.

    Attributes:
        unit: `deg`, `range` (−100 … 100) or `rad`; None to infer it from the readings.
        calibration: LeRobot's calibration file, or one for each arm.
        rate: Rate [Hz] in place of the dataset's.
        uniform: Whether rows are evenly spaced regardless of their time stamps.
    """

    unit: str | None = None
    calibration: tuple[Path, ...] = ()
    rate: float | None = None
    uniform: bool = False

    def __post_init__(self) -> None:
        if self.unit is not None and self.unit not in UNITS:
            raise OptionError(f"--unit is '{self.unit}'; choose one of: {', '.join(UNITS)}.")
        if self.rate is not None and not (np.isfinite(self.rate) and self.rate > 0):
            raise OptionError(f"--rate is {self.rate:g}; it must be above 0.")

    @property
    def needs_map(self) -> bool:
        """Whether values must be converted."""
        return self.unit is not None or bool(self.calibration)


def is_dataset(path: Path) -> bool:
    """Return whether a path is a dataset's folder, or a folder of its versions."""
    return is_folder_log(path, "lerobot")


def complete_map(mapping: Map, paths: Sequence[Path], options: ImportOptions) -> tuple[Map, tuple[str, ...]]:
    """Complete a map of LeRobot datasets with their rate and units.

    Args:
        mapping: A map of the format `lerobot`.
        paths: The datasets.
        options: Options of the user.

    Returns:
        The completed map, and notes on the decisions.

    Raises:
        LogError, OptionError, MapError: map, datasets, calibration and options do not match.
    """
    for path in paths:
        if not path.exists():
            raise LogError(f"There is no log {path}; give recorded files or folders.")
        if not is_dataset(path):
            raise LogError(f"{path} is not {find_folder_kind('lerobot')}; give the folder of one.")
        _refuse_own(resolve(path))
    rates = {path: DatasetInfo.read(resolve(path)).fps for path in paths}
    first, *_ = rates
    other = next((path for path in paths if abs(rates[path] / rates[first] - 1) > SAME_RATE), None)
    if other is not None:
        raise OptionError(
            f"{other} runs at {rates[other]:g} Hz, {first} at {rates[first]:g} Hz; import them one at a time."
        )
    mapping = replace(
        mapping,
        rate=options.rate or mapping.rate or rates[first],
        remedies=mapping.remedies or BY_OPTIONS_OR_MAP,
    )
    if options.uniform:
        mapping = replace(mapping, clock=TimeColumn("", "s"))
    mapping, derived = derive_missing_velocity(mapping, paths, options.unit)
    mapping, units = _complete_units(mapping, paths, options)
    return complete_velocity(mapping, (*units, *derived), paths)


def _complete_units(mapping: Map, paths: Sequence[Path], options: ImportOptions) -> tuple[Map, tuple[str, ...]]:
    """Replace degrees by the unit of the datasets; arguments and result as for `complete_map`."""
    motors, is_generated = match_motors(mapping, options.calibration), mapping.name == GENERATED
    if "deg" not in mapping.position.conversion.units:
        if options.unit is not None and not is_generated:
            raise OptionError(
                f"The map {mapping.name} gives no joint in degrees, which --unit would replace; leave --unit out, or "
                "write the unit in the map."
            )
        return with_raw_unit(mapping, "deg", motors), ()
    unit, why = options.unit, "as given by --unit"
    if unit is None:
        recordings, findings = read_datasets(paths, mapping)
        refuse_nothing(recordings, findings)
        raw = [mapping.position.conversion.raw(part.positions) for part in recordings]
        unit, why = choose_unit(mapping, np.concatenate(raw), motors)
    words = {"deg": "degrees", "range": "−100 … 100", "rad": "radians"}[unit]
    completed = with_raw_unit(mapping, unit, motors)
    if unit != "deg":
        likewise = ", velocities likewise" if is_generated and mapping.velocity else ""
        head = (
            f"# Positions that this map gives in degrees were read as {words} ({why}){likewise}; see meta/nas.json.\n"
        )
        completed = replace(completed, text=head + mapping.text)
    notes = [f"Read as {words} ({why})."]
    units = zip(completed.joints, completed.position.conversion.units, strict=True)
    if shares := [joint for joint, held in units if held == NORMALISED]:
        closes = " If it closes at the upper end, write a map with low and high exchanged." if is_generated else ""
        notes.append(f"Read as a share of the joint's range, 0 … 100 in LeRobot: {', '.join(shares)}.{closes}")
    return completed, tuple(notes)


def map_text(path: Path, unit: str | None, model: str | None) -> str:
    """Return the text of a map for a dataset with all joints in one unit and with its own joint names.

    Velocities that its states hold in that unit per second are read. With unit `rad` joints may make several turns.
    LeRobot stores a gripper as 0 … 100 of its range; the range is taken from the model.

    Raises:
        JointMismatch: its components have no names.
        OptionError: it has a gripper, and no model gives its range.
    """
    root = resolve(path)
    dataset = read(root)
    components = Components.of(STATE, dataset.features[STATE])
    joints, measured = tuple(components.positions), _has_velocities(dataset.features[STATE], components, unit)
    grippers = [joint for joint in joints if is_gripper(joint)] if unit != "rad" else []
    tables, lengths = "", list[str]()
    for gripper in grippers:
        low, high, slides = _find_gripper_range(path, gripper, model)
        lengths += [gripper] if slides else []
        line = f'unit = "normalised"\nrange = [0.0, 100.0]\nlow = {low!r}\nhigh = {high!r}\n'
        quantities = ("position", *["velocity"] * measured, "command")
        tables += "".join(f"[read.{what}.joints.{_quote(gripper)}]\n{line}" for what in quantities)
    velocities = ", ".join(_quote(joint + VELOCITY) for joint in joints)
    return (
        f'format = "lerobot"\nrobot = {_quote(dataset.robot_type)}\njoints = [{", ".join(map(_quote, joints))}]\n'
        f"slides = [{', '.join(map(_quote, lengths))}]\n"
        f'alignment = "action_follows_state"\nvelocity = "{"measured" if measured else "derive"}"\n'
        '[servo]\nresolution = 4096\ndrive_mode = true\n[read.position]\nunit = "deg"\n[read.command]\nunit = "deg"\n'
        + (f'[read.velocity]\ncolumn = "{STATE}"\nnames = [{velocities}]\nunit = "deg/s"\n' if measured else "")
        + tables
        + ('[audit]\nallow = ["unit_slip"]\n' if unit == "rad" else "")
    )


def _has_velocities(state: Feature, components: Components, unit: str | None) -> bool:
    """Whether a state has the velocities of all joints, stored without a unit or in the unit of the positions."""
    units = {state.units[place] for place in components.velocities.values()} if state.units else set()
    return set(components.velocities) >= set(components.positions) and units <= {f"{unit}/s"}


def _quote(text: str) -> str:
    """Return a text as TOML, whose strings have JSON's escapes."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _find_gripper_range(path: Path, joint: str, model: str | None) -> tuple[float, float, bool]:
    """Return the range of a gripper in a model [rad; m] and whether it is a slide.

    Raises:
        OptionError: there is no model, or no such joint or range in it.
    """
    if model is None:
        raise OptionError(
            f"{path} has a joint '{joint}', which LeRobot gives as 0 … 100 of its range: add --model MODEL.xml, which "
            "has the range of that joint."
        )
    import mujoco

    from nas_data.robots.base import find_robot

    spec = find_robot(model).spec().compile()
    names = [spec.joint(index).name for index in range(spec.njnt)]
    if joint not in names or not spec.jnt_limited[spec.joint(joint).id]:
        raise OptionError(f"{model} has no joint '{joint}' with a range; give one in the model, or write a map.")
    low, high = spec.joint(joint).range
    return float(low), float(high), int(spec.joint(joint).type[0]) == int(mujoco.mjtJoint.mjJNT_SLIDE)


def report_unit_grippers(dataset: Dataset, mapping: Map | None) -> list[AuditFinding]:
    """Return findings on grippers in radians or metres that just span 0 … 1 or 0 … 100, as a share of a range does."""
    units = mapping.position.conversion.units if mapping else ("",) * len(dataset.joints)
    found = []
    for index, (joint, stored) in enumerate(zip(dataset.joints, units, strict=True)):
        if stored == NORMALISED:
            continue
        values = dataset.states[:, index]
        low, high = float(values.min()), float(values.max())
        top = next((top for top in (1.0, LARGEST) if OPEN * top <= high <= (2 - OPEN) * top), None)
        if is_gripper(joint) and top and abs(low) <= (1 - OPEN) * top:
            unit = "metres" if joint in dataset.slides else "radians"
            what = f"{joint} spans {low:.3g} … {high:.3g} and was read as {unit}"
            keys = f"unit = 'normalised', range = [0.0, {top:.1f}], low and high"
            remedy = f"if these are shares of its range, write {keys} in a map"
            found.append(AuditFinding("unit_slip", "the dataset", what, remedy))
    return found


def import_dataset(path: Path, options: ImportOptions) -> tuple[Dataset, Provenance, tuple[AuditFinding, ...]]:
    """Read a dataset in SI units as transitions; episodes are divided at gaps in its clock.

    Args:
        path: Folder of the dataset.
        options: Options on rate and clock.

    Raises:
        OptionError: it was recorded or imported by nas already.
        DatasetInvalid, JointMismatch: it cannot be used.
    """
    root = resolve(path)
    _refuse_own(root)
    original = read(root)
    recorded = original
    if options.uniform:
        recorded = recorded.without_columns({TIME})  # the recorder's clock
    elif TIME not in recorded.features:
        recorded = with_clock(recorded, read_stamps(root))
    if options.rate is not None:
        recorded = replace(recorded, fps=options.rate)
        if recorded.passthrough and options.rate != original.fps:
            recorded = replace(recorded, passthrough=recorded.passthrough.without_videos())
    gaps = find_gaps(recorded)
    divided = cut_at(recorded, [frame for frame, _ in gaps])
    try:
        dataset, derived = as_transitions(divided)
    except DatasetInvalid as error:
        raise DatasetInvalid(str(error).replace(REMEDY, import_command(path, recorded))) from None
    refuse_unknown_unit(path, recorded)
    findings = (
        *_report_gaps(recorded, gaps),
        *report_single_frames(divided),
        *_report_videos(path, original, recorded),
        *audit_dataset(dataset, BY_OPTIONS),
    )
    refuse(path, findings, recorded)
    provenance = Provenance(
        how="imported",
        robot=dataset.robot_type,
        target={"kind": "LeRobot dataset"},
        parents=(make_parent(root, original),),
        derived=derived,
        contiguous=True,
        notes="\n".join(f"{finding.check}: {finding.file}: {finding.message}" for finding in findings),
    )
    return dataset, provenance, findings


def _refuse_own(root: Path) -> None:
    """Raise OptionError for datasets that nas recorded or imported, which can be used directly."""
    if is_ours(read_provenance(root)):
        raise OptionError(f"{root} is a dataset of nas already; use it as it is (nas info, nas pair, nas gap).")


def _report_videos(path: Path, before: Dataset, after: Dataset) -> list[AuditFinding]:
    """Return a finding on the videos that are left out, if there are any."""
    had, has = (dataset.passthrough.features if dataset.passthrough else {} for dataset in (before, after))
    lost = {key: entry for key, entry in had.items() if key not in has}
    return [AuditFinding("left_out", str(path), describe_left_out(lost, VIDEO_LEFT_OUT), minor=True)] if lost else []


def _report_gaps(dataset: Dataset, gaps: Sequence[tuple[int, float]]) -> list[AuditFinding]:
    """Return findings on the gaps at which episodes are divided."""
    found = []
    for frame, gap in gaps:
        episode = int(np.searchsorted(dataset.starts, frame, side="right")) - 1
        row = frame - int(dataset.starts[episode])
        what = (
            f"{gap:.3g} s are missing before {format_rows([row])}; the episode is divided there into two, because "
            "nothing was measured in between"
        )
        found.append(AuditFinding("time_gap", f"episode {episode}", what, rows=(row,)))
    return found
