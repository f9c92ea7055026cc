"""Datasets from arrays: shapes and options are checked, and the result is audited."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from nas_data.arrays import Array
from nas_data.count_of import count_of
from nas_data.dataset.audits import audit_dataset
from nas_data.dataset.checks import check_finite
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.external import format_warnings, report_single_frames
from nas_data.dataset.features import (
    ACTION,
    EFFORT,
    POSITION,
    STATE,
    TIME,
    VELOCITY,
    Feature,
    make_action_feature,
    make_position_feature,
    make_state_feature,
    make_time_feature,
)
from nas_data.dataset.origin import Origin
from nas_data.dataset.provenance import Provenance
from nas_data.dataset.transitions import as_transitions
from nas_data.errors import DatasetInvalid, JointMismatch, OptionError
from nas_data.log import warn

CommandKind = Literal["position", "velocity", "torque"]
Episodes = Array | Sequence[Array]
KINDS: Mapping[str, str] = {"position": POSITION, "velocity": VELOCITY, "torque": EFFORT}
REMEDIES = {
    "rate": "correct 'rate', or the times",
    "command_sign": "reverse the sign of one of them, or give the kind of command: kind='torque' or 'velocity'",
    "command_scale": "give positions and commands in one unit",
    "command_is_position": "give the commands, not what was measured",
    "joints_swapped": "put the columns of both in the order of 'joints'",
    "time_gap": "divide the arrays there: lists of arrays, one an episode",
    "irregular_time": "resample the rows, or leave 'times' out if the rows are evenly spaced",
    "velocity_scale": "correct 'velocities', or leave them out, so that they are derived from the positions",
    "velocity_lag": "leave 'velocities' out, so that they are derived from the positions",
    "position_contradicts_velocity": "correct the arrays, or leave 'velocities' out",
    "jump": "if encoders wrap around, give numpy.unwrap(positions, axis=0)",
    "unit_slip": "give radians and metres, numpy.radians(positions), or pass turns=True if a joint does turn that far",
}


def make_from_arrays(
    positions: Episodes,
    commands: Episodes,
    rate: float,
    joints: Sequence[str],
    velocities: Episodes | None,
    times: Episodes | None,
    kind: CommandKind | Sequence[CommandKind],
    slides: Sequence[str],
    turns: bool,
    robot: str,
    tasks: Sequence[str],
) -> Dataset:
    """Make a dataset from arrays; see `Dataset.from_arrays`."""
    kinds = (kind,) * len(joints) if isinstance(kind, str) else tuple(kind)
    check_options(rate, joints, kinds, slides)
    n = len(joints)
    measured = split_episodes(positions, n, "positions")
    asked = [
        np.concatenate([part, part[-1:]]) if len(part) + 1 == len(rows) else part
        for part, rows in zip_episodes(split_episodes(commands, n, "commands"), measured, "commands")
    ]
    columns = {STATE: measured, ACTION: asked}
    features: dict[str, Feature] = {STATE: make_position_feature(joints, slides)}
    features[ACTION] = make_action_feature(joints, [KINDS[each] for each in kinds], slides)
    if velocities is not None:
        pairs = zip_episodes(split_episodes(velocities, n, "velocities"), measured, "velocities")
        columns[STATE] = [
            np.concatenate([rows, part], axis=1) for part, rows in pairs if check_same_length(part, rows, "velocities")
        ]
        features[STATE] = make_state_feature(joints, slides)
    if times is not None:
        pairs = zip_episodes(split_episodes(times, 1, "times", depth=1), measured, "times")
        columns[TIME] = [part - part[:1] for part, rows in pairs if check_same_length(part, rows, "times")]
        features[TIME] = make_time_feature()
    for part, rows in zip(asked, measured, strict=True):
        check_same_length(part, rows, "commands")
    if len(tasks) not in (0, len(measured)):
        raise DatasetInvalid(
            f"There are {count_of(len(tasks), 'task')} for {count_of(len(measured), 'episode')}; give one for each, or "
            "none."
        )
    dataset = Dataset(
        features=features,
        columns={key: np.concatenate(parts).astype(features[key].dtype) for key, parts in columns.items()},
        lengths=np.array([len(part) for part in measured]),
        fps=float(rate),
        robot_type=robot,
        tasks=tuple(tasks),
    )
    check_finite(dataset, "The recording in memory")
    complete, derived = as_transitions(dataset)
    warn(format_warnings(report_single_frames(dataset)))
    refuse(complete, turns)
    provenance = Provenance(how="imported", robot=robot, target={"kind": "arrays"}, derived=derived, contiguous=True)
    return replace(complete, origin=Origin(complete, provenance, derived))


def check_options(rate: float, joints: Sequence[str], kinds: Sequence[str], slides: Sequence[str]) -> None:
    """Refuse an invalid rate, a wrong list of command kinds or of joints.

    Raises:
        OptionError: the rate or the kind is invalid.
        JointMismatch: a slide is not among the joints, or a joint is named twice.
    """
    if not (np.isfinite(rate) and rate > 0):
        raise OptionError(f"rate is {rate}; give the control rate [Hz], above 0.")
    if strange := [kind for kind in kinds if kind not in KINDS]:
        raise OptionError(f"kind is '{strange[0]}'; choose one of: {', '.join(KINDS)}.")
    if not joints or len(set(joints)) < len(joints):
        raise JointMismatch(f"joints are {', '.join(joints) or 'none'}; give each joint one name of its own.")
    if len(kinds) != len(joints):
        raise OptionError(
            f"kind is {', '.join(kinds) or 'empty'}; give one kind, or one for each joint: {', '.join(joints)}."
        )
    strange = [joint for joint in slides if joint not in joints]
    if strange:
        raise JointMismatch(f"slides name '{strange[0]}', which is no joint; choose among: {', '.join(joints)}.")


def split_episodes(values: Episodes, width: int, what: str, depth: int = 2) -> list[Array]:
    """Split an argument into one array of shape (T, width) per episode.

    Args:
        values: One such array, a list of them, or an array of shape (E, T, width); anything that numpy can read, such
            as a DataFrame. A width of 1 may be left out: (T,) for one episode.
        width: Expected width.
        what: Name of the argument in error messages.
        depth: Dimensions of one episode: 2, or 1 for a clock.

    Raises:
        DatasetInvalid: the shape is another, there are no rows, or values are no numbers.
    """
    listed = np.atleast_1d(values) if hasattr(values, "__array__") else list(values)
    one = not len(listed) or np.ndim(listed[0]) < depth
    try:
        arrays = [np.asarray(part, float) for part in ([listed] if one else listed)]
    except (TypeError, ValueError):
        raise DatasetInvalid(
            f"The {what} are not numbers in rows of {width}; give an array (T, {width}), or one per episode."
        ) from None
    arrays = [part[:, None] if part.ndim == 1 and width == 1 else part for part in arrays]
    wrong = next((part.shape for part in arrays if part.ndim != 2 or part.shape[1] != width or not len(part)), None)
    if wrong is None:
        return arrays
    if wrong[:1] == (0,):
        raise DatasetInvalid(f"An episode of {what} has no rows (shape {wrong}); leave it out, or give its rows.")
    raise DatasetInvalid(f"An episode of {what} has shape {wrong}; (T, {width}) is needed, a column a joint.")


def zip_episodes(parts: list[Array], measured: list[Array], what: str) -> list[tuple[Array, Array]]:
    """Return pairs of each episode's values and positions.

    Raises:
        DatasetInvalid: the numbers of episodes differ.
    """
    if len(parts) != len(measured):
        raise DatasetInvalid(
            f"The positions are of {count_of(len(measured), 'episode')}, the {what} of {len(parts)}; give equally many."
        )
    return list(zip(parts, measured, strict=True))


def check_same_length(part: Array, rows: Array, what: str) -> bool:
    """Check that an episode has as many rows of an argument as of positions.

    Raises:
        DatasetInvalid: the numbers of rows differ.
    """
    if len(part) != len(rows):
        raise DatasetInvalid(
            f"An episode has {count_of(len(rows), 'row')} of positions and {len(part)} of {what}; give equally many."
        )
    return True


def refuse(dataset: Dataset, turns: bool) -> None:
    """Audit a dataset made from arrays; warnings go to stderr.

    Args:
        dataset: Transitions.
        turns: Whether joints may turn farther than two turns.

    Raises:
        DatasetInvalid: the audits report an error.
    """
    findings = audit_dataset(dataset, turns=turns)
    error = next((finding for finding in findings if finding.error), None)
    if error is not None:
        remedy = REMEDIES.get(error.check, "correct the arrays")
        raise DatasetInvalid(f"The arrays: in {error.file} {error.what}; {remedy}.")
    warn(format_warnings([replace(finding, remedy=REMEDIES.get(finding.check, "")) for finding in findings]))
