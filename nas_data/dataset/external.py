"""Audit of datasets that other tools recorded; errors name the command that imports the dataset.

Datasets that nas recorded or imported were audited at that time.
"""

import re
import shlex
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeAlias

import numpy as np

from nas_data.dataset.audits import audit_dataset
from nas_data.dataset.audits.base import IMPORTED, UNWRAP, AuditFinding
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import STATE, VELOCITY
from nas_data.dataset.joints import REMEDY, is_gripper
from nas_data.dataset.provenance import Provenance, read_provenance
from nas_data.dataset.transitions import as_transitions, list_single_frames
from nas_data.errors import DatasetInvalid, JointMismatch

OURS = {"simulated", "hardware", "imported", "paired"}
MAPS = Path(__file__).parents[1] / "importing" / "maps"
ALSO_CALLED = {"so_follower": "so101_follower"}  # LeRobot's name of a SO-100 and a SO-101, whose encoders are equal
LARGEST = 100.001  # bound of LeRobot's −100 … 100, with rounding
Refusal: TypeAlias = DatasetInvalid | JointMismatch
LEROBOT = "_lerobot"  # suffix of the names of maps for LeRobot's datasets


def audit_external(root: Path, recorded: Dataset) -> tuple[Dataset, dict[str, str], tuple[str, ...]]:
    """Convert a dataset to transitions; audit it if another tool recorded it.

    Args:
        root: Its folder.
        recorded: Its content, or some of its episodes.

    Returns:
        Transitions, derived features (feature → how), and warnings.

    Raises:
        JointMismatch: state and action name different joints, or none.
        DatasetInvalid: the unit is not radians, or an audit finds an error; the message names the command
            that imports the dataset.
    """
    try:
        dataset, derived = as_transitions(recorded)
    except (DatasetInvalid, JointMismatch) as error:
        said = str(error).replace(REMEDY, import_command(root, recorded))
        raise name_folder(root, type(error)(said)) from None
    if is_ours(read_provenance(root)):
        return dataset, derived, ()
    findings = (*report_single_frames(recorded), *audit_dataset(dataset))
    refuse(root, findings, recorded)
    found = [replace(finding, remedy=find_remedy(root, finding, recorded)) for finding in findings]
    warnings = format_warnings(found)
    if not recorded.features[STATE].units:
        radians = f"nas import {shlex.quote(str(root))} --unit rad"
        assumed = f"{root} stores no unit: taken as radians; if that is right, store it: {radians}"
        warnings = (f"{assumed}; if not, {import_command(root, recorded)}", *warnings)
    return dataset, derived, warnings


def name_folder(root: Path, error: Refusal) -> Refusal:
    """Return an error about a dataset whose message begins with the dataset's folder, unless it names the folder."""
    said = str(error)
    if re.search(rf"(?<![\w/.-]){re.escape(str(root))}(?![\w-])", said):
        return error
    return type(error)(f"{root}: {said[:1].lower()}{said[1:]}")


def report_single_frames(dataset: Dataset) -> list[AuditFinding]:
    """Return findings on the episodes of one frame, which are left out of the transitions."""
    what = "there is a single frame, which makes no transition: it is left out, and later episodes are renumbered"
    numbers = dataset.episode_numbers
    return [AuditFinding("too_short", f"episode {numbers[place]}", what) for place in list_single_frames(dataset)]


def is_ours(provenance: Provenance | None) -> bool:
    """Whether nas recorded or imported a dataset or all its parents; then it is in SI units and was audited."""
    if provenance is None:
        return False
    # of datasets without parents, only those of nas are contiguous; others are contiguous if all their parents are
    return provenance.how in OURS or (provenance.how == "edited" and provenance.contiguous and bool(provenance.parents))


def refuse(root: Path, findings: Sequence[AuditFinding], dataset: Dataset) -> None:
    """Raise DatasetInvalid if there is an error; the message has the command that imports the dataset."""
    error = next((finding for finding in findings if finding.error), None)
    if error is None:
        return
    raise DatasetInvalid(f"{root}: in {error.file} {error.what}; {find_remedy(root, error, dataset)}.")


def refuse_unknown_unit(root: Path, dataset: Dataset) -> None:
    """Raise DatasetInvalid if no unit is stored and LeRobot records this robot in other units than radians."""
    if dataset.features[STATE].units or not map_for(dataset.robot_type):
        return
    raise DatasetInvalid(
        f"{root} stores no unit, and LeRobot records a {dataset.robot_type} in degrees or −100 … 100; "
        f"{import_command(root, dataset)}; if these are radians: nas import {shlex.quote(str(root))} --unit rad."
    )


def add_remedy(root: Path, provenance: Provenance | None, finding: AuditFinding, dataset: Dataset) -> AuditFinding:
    """Return a finding with the remedy that the origin of the dataset allows; none for what nas recorded itself."""
    if not is_ours(provenance):
        remedy = find_remedy(root, finding, dataset)
    elif provenance is not None and provenance.how == "imported":
        remedy = IMPORTED.apply(finding, dataset.fps).remedy
    else:
        remedy = ""
    return replace(finding, remedy=remedy)


def find_remedy(root: Path, finding: AuditFinding, dataset: Dataset) -> str:
    """Return the remedy for a finding in a dataset of another tool: commands with its folder; empty if none."""
    command = f"nas import {shlex.quote(str(root))}"
    if finding.check == "rate":
        median = finding.what.partition(" come at ")[2].partition(" Hz")[0]
        return (
            f"if these times are right, import it at their rate ({command} --rate {median}); if the dataset's "
            f"fps is right, ignore the times ({command} --uniform)"
        )
    if finding.check == "time_gap":
        return f"{command} divides the episodes there"
    if finding.check in ("time_backwards", "repeated_time", "not_finite"):  # other values were checked when read
        return f"import it and ignore its time stamps: {command} --uniform"
    if finding.check == "irregular_time":
        return f"if only the time stamps are uneven, ignore them: {command} --uniform"
    if finding.check == "unit_slip":
        return import_command(root, dataset)
    by_own_map = replace(IMPORTED, elsewhere=f"import it with a map of your own ({command} --map MAP.toml)")
    return by_own_map.apply(finding, dataset.fps).remedy.replace(UNWRAP, f"{command} --unwrap")


def import_command(root: Path, dataset: Dataset) -> str:
    """Return the command that imports a dataset of degrees or −100 … 100; both commands if the unit is ambiguous."""
    where = shlex.quote(str(root))
    name = map_for(dataset.robot_type)
    if name:
        return f"import it: nas import {where} --map {name}"
    names = dataset.features[STATE].names
    body = [column for column, name in enumerate(names) if not (is_gripper(name) or name.endswith(VELOCITY))]
    more = " --model MODEL.xml" if any(map(is_gripper, names)) else ""
    could_be_range = np.abs(dataset.columns[STATE][:, body]).max(initial=0.0) <= LARGEST
    other = "LeRobot's −100 … 100 need --unit range --calibration FILE instead of --unit deg; if these are degrees, "
    return (other if could_be_range else "") + f"import it: nas import {where} --unit deg{more}"


def map_for(robot_type: str) -> str | None:
    """Return the included map for LeRobot's name of a robot; None if there is none."""
    robot_type = ALSO_CALLED.get(robot_type, robot_type)
    names = sorted(file.stem for file in MAPS.glob(f"*{LEROBOT}.toml") if file.stem != "example" + LEROBOT)
    return next((name for name in names if robot_type.startswith(name.removesuffix(LEROBOT))), None)


def format_warnings(findings: Sequence[AuditFinding]) -> tuple[str, ...]:
    """Return a sentence for each kind of finding, with its count and remedy."""
    kinds: dict[str, list[AuditFinding]] = {}
    for finding in findings:
        if not finding.minor:
            kinds.setdefault(finding.check, []).append(finding)
    return tuple(
        f"in {members[0].file} {members[0].what}"
        + (f" (and {len(members) - 1} more like this)" if members[1:] else "")
        + (f"; {members[0].remedy}" if members[0].remedy else "")
        for members in kinds.values()
    )
