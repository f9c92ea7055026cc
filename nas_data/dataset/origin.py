"""Datasets in memory with their origin: loading, creation from arrays, saving, conversion to a table."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Literal

import numpy as np

from nas_data.arrays import Array
from nas_data.count_of import count_of
from nas_data.dataset import versions
from nas_data.dataset.audits import audit_dataset
from nas_data.dataset.checks import check_finite
from nas_data.dataset.content import hash_content
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.derive_provenance import make_unknown_provenance, read_attachments
from nas_data.dataset.external import audit_external, format_warnings
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
from nas_data.dataset.joints import NAMES, REMEDY, SAME_NAMES
from nas_data.dataset.layout import PROVENANCE
from nas_data.dataset.provenance import Parent, Provenance, format_current_time, read_package_versions, read_provenance
from nas_data.dataset.read import read
from nas_data.dataset.transitions import as_transitions
from nas_data.dataset.write import encode_json
from nas_data.errors import DatasetInvalid, JointMismatch, OptionError
from nas_data.log import warn

if TYPE_CHECKING:
    import pandas

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
TO_SI = "convert the columns first, numpy.radians(states), and set the units of the features to match"
IN_PYTHON = {  # remedies of commands → those for a dataset in memory
    REMEDY: TO_SI,
    NAMES: "make it with its joints: nas_data.Dataset.from_arrays(positions, commands, rate=rate, joints=names)",
    SAME_NAMES: "name the same joints in the features of both",
}
EDITED = "edited in Python"


@dataclass(frozen=True)
class Origin:
    """Origin of a dataset in memory; `save` writes it as provenance.

    Attributes:
        dataset: The content that the provenance describes.
        provenance: Content of `meta/nas.json`.
        derived: Features derived while reading: feature → how.
        root: Folder that it was read from; None if it was made in memory.
        recorded: Content of that folder, without derived features.
        attachments: Extra files by path, such as the source model of the predictions.
        noticed: Warnings of the audits, already shown on stderr.
    """

    dataset: Dataset
    provenance: Provenance
    derived: Mapping[str, str] = field(default_factory=dict)
    root: Path | None = None
    recorded: Dataset | None = None
    attachments: Mapping[str, bytes] = field(default_factory=dict)
    noticed: tuple[str, ...] = ()

    @cached_property
    def parents(self) -> tuple[Parent, ...]:
        """Parents for the provenance of a dataset made from it."""
        if self.root is None or self.recorded is None:
            return self.provenance.parents
        return (versions.make_parent(self.root, self.recorded),)


def load(path: Path, episodes: Sequence[int] = ()) -> Dataset:
    """Read a dataset; see `Dataset.load`."""
    root = versions.resolve(path)
    recorded = read(root)
    dataset, derived, noticed = audit_external(root, recorded.select(episodes) if episodes else recorded)
    warn(noticed)
    before = read_provenance(root)
    kept = read_attachments(root, before)
    before = before or make_unknown_provenance(recorded)
    provenance = replace(before, derived={**before.derived, **derived})
    return replace(dataset, origin=Origin(dataset, provenance, derived, root, recorded, kept, noticed))


def with_origin(dataset: Dataset) -> Dataset:
    """Return a dataset as transitions with an origin; without one of its own, it counts as made in Python.

    Raises:
        JointMismatch, DatasetInvalid: it cannot be converted to transitions.
    """
    if dataset.origin is not None:
        return dataset
    try:
        complete, derived = as_transitions(dataset)
    except (DatasetInvalid, JointMismatch) as error:
        said = str(error)
        for of_command, in_python in IN_PYTHON.items():
            said = said.replace(of_command, in_python)
        raise type(error)(said) from None
    provenance = Provenance(how="edited", robot=dataset.robot_type, derived=derived, notes=EDITED)
    return replace(complete, origin=Origin(complete, provenance, derived))


def find_identity(dataset: Dataset) -> Parent:
    """Return the name and content hash by which checkpoints and derived datasets refer to it."""
    origin = dataset.origin
    if origin is not None and origin.root is not None and is_unchanged(dataset, origin):
        return origin.parents[0]
    named = origin.parents[0].name if origin and origin.parents else dataset.robot_type
    return Parent(named, hash_content(dataset))


def is_unchanged(dataset: Dataset, origin: Origin) -> bool:
    """Whether a dataset still has the content that its origin describes."""
    if dataset.columns is origin.dataset.columns and dataset.features is origin.dataset.features:
        return True
    return hash_content(dataset) == hash_content(origin.dataset)


def describe(dataset: Dataset) -> tuple[Provenance, Mapping[str, bytes]]:
    """Return provenance and extra files of a dataset to be written."""
    origin = with_origin(dataset).origin
    assert origin is not None
    if not is_unchanged(dataset, origin):
        provenance = origin.provenance
        notes = "\n".join(filter(None, [provenance.notes, EDITED]))
        edited = {
            "how": "edited",
            "when": format_current_time(),
            "packages": dict(read_package_versions()),
            "notes": notes,
        }
        return replace(provenance, **edited, parents=origin.parents), origin.attachments  # type: ignore[arg-type]
    if origin.derived and origin.root is not None:
        return replace(origin.provenance, parents=origin.parents), origin.attachments
    return origin.provenance, origin.attachments


def save(dataset: Dataset, path: Path) -> Path:
    """Write a dataset as the next version of a name; see `Dataset.save`."""
    if versions.VERSION.fullmatch(path.name):
        path = path.parent
    provenance, files = describe(dataset)
    return versions.write_version(dataset, path.name, provenance, path.parent, files)


@contextmanager
def kept_folders(dataset: Dataset) -> Iterator[list[Path]]:
    """Yield the folders that may hold the source of a paired dataset."""
    origin = dataset.origin
    if origin is None:
        yield []
        return
    if origin.root is not None:
        yield [origin.root]
        return
    with TemporaryDirectory() as folder:
        files = {**origin.attachments, PROVENANCE: encode_json(origin.provenance.to_json())}
        for name, content in files.items():
            path = Path(folder, name)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
        yield [Path(folder)]


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


def as_frame(dataset: Dataset) -> "pandas.DataFrame":
    """Return a dataset as a table; see `Dataset.to_pandas`."""
    import pandas as pd

    lengths = np.asarray(dataset.lengths)
    frame = np.arange(dataset.n_frames) - np.repeat(dataset.starts, lengths)
    rows = pd.MultiIndex.from_arrays([np.repeat(np.arange(len(lengths)), lengths), frame], names=("episode", "frame"))
    parts = {key: pd.DataFrame(dataset.columns[key], rows, item.names) for key, item in dataset.features.items()}
    return pd.concat(parts, axis=1, names=("feature", "component"))
