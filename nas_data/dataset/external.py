"""Audit of datasets that other tools recorded; errors name the command that imports the dataset.

Datasets that nas recorded or imported were audited at that time.
"""

import shlex
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from nas_data.dataset.audits import audit_dataset
from nas_data.dataset.audits.base import AuditFinding
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import STATE, VELOCITY
from nas_data.dataset.joints import REMEDY
from nas_data.dataset.provenance import Provenance, read_provenance
from nas_data.dataset.transitions import as_transitions
from nas_data.errors import DatasetInvalid

OURS = {"simulated", "hardware", "imported", "paired"}
MAPS = Path(__file__).parents[1] / "importing" / "maps"
REFUSED = ("rate", "time_gap", "time_backwards", "repeated_time", "not_finite", "unit_slip")
ALSO_CALLED = {"so_follower": "so101_follower"}  # LeRobot's name of a SO-100 and a SO-101, whose encoders are equal
LARGEST = 100.001  # bound of LeRobot's −100 … 100, with rounding
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
        DatasetInvalid: the unit is not radians, or the clock contradicts the rate or has gaps; the message names the
            command that imports the dataset.
    """
    try:
        dataset, derived = as_transitions(recorded)
    except DatasetInvalid as error:
        raise DatasetInvalid(str(error).replace(REMEDY, import_command(root, recorded))) from None
    if is_ours(read_provenance(root)):
        return dataset, derived, ()
    findings = audit_dataset(dataset)
    refuse(root, findings, recorded)
    return dataset, derived, format_warnings(findings)


def is_ours(provenance: Provenance | None) -> bool:
    """Whether nas recorded or imported a dataset; then it is in SI units and was audited."""
    return provenance is not None and provenance.how in OURS


def refuse(root: Path, findings: Sequence[AuditFinding], dataset: Dataset) -> None:
    """Raise DatasetInvalid if clock or unit are wrong; the message has the command that imports the dataset."""
    error = next((finding for finding in findings if finding.error and finding.check in REFUSED), None)
    if error is None:
        return
    where = shlex.quote(str(root))
    if error.check == "rate":
        median = error.what.partition(" come at ")[2].partition(" Hz")[0]
        remedy = (
            f"if these times are right, import it at their rate (nas import {where} --rate {median}); if the dataset's "
            f"fps is right, ignore the times (nas import {where} --uniform)"
        )
    elif error.check == "time_gap":
        remedy = f"nas import {where} divides the episodes there"
    elif error.check in ("time_backwards", "repeated_time", "not_finite"):  # other values were checked when read
        remedy = f"import it and ignore its time stamps: nas import {where} --uniform"
    else:
        remedy = import_command(root, dataset)
    raise DatasetInvalid(f"{root}: in {error.file} {error.what}; {remedy}.")


def import_command(root: Path, dataset: Dataset) -> str:
    """Return the command that imports a dataset of degrees or −100 … 100; both commands if the unit is ambiguous."""
    where = shlex.quote(str(root))
    name = map_for(dataset.robot_type)
    if name:
        return f"import it: nas import {where} --map {name}"
    names = dataset.features[STATE].names
    body = [column for column, name in enumerate(names) if not ("gripper" in name or name.endswith(VELOCITY))]
    more = " --model MODEL.xml" if any("gripper" in name for name in names) else ""
    could_be_range = np.abs(dataset.columns[STATE][:, body]).max(initial=0.0) <= LARGEST
    other = "LeRobot's −100 … 100 need --unit range --calibration FILE instead of --unit deg; if these are degrees, "
    return (other if could_be_range else "") + f"import it: nas import {where} --unit deg{more}"


def map_for(robot_type: str) -> str | None:
    """Return the included map for LeRobot's name of a robot; None if there is none."""
    robot_type = ALSO_CALLED.get(robot_type, robot_type)
    names = sorted(file.stem for file in MAPS.glob(f"*{LEROBOT}.toml") if file.stem != "example" + LEROBOT)
    return next((name for name in names if robot_type.startswith(name.removesuffix(LEROBOT))), None)


def format_warnings(findings: Sequence[AuditFinding]) -> tuple[str, ...]:
    """Return a sentence for each kind of finding, with its count."""
    kinds: dict[str, list[AuditFinding]] = {}
    for finding in findings:
        if not finding.minor:
            kinds.setdefault(finding.check, []).append(finding)
    return tuple(
        f"in {members[0].file} {members[0].what}" + (f" (and {len(members) - 1} more like this)" if members[1:] else "")
        for members in kinds.values()
    )
