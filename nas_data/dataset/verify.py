"""Verification of a dataset on disk: files, rows, values, clock and provenance."""

import hashlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import pyarrow as pa

from nas_data.count_of import count_of
from nas_data.dataset import layout
from nas_data.dataset.audits import audit_dataset
from nas_data.dataset.audits.base import AuditFinding
from nas_data.dataset.content import choose_content_hash
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.external import add_remedy, is_ours
from nas_data.dataset.features import NEXT_STATE, STATE, TIME, Feature
from nas_data.dataset.info import DatasetInfo
from nas_data.dataset.parquet import read_parquet
from nas_data.dataset.provenance import Provenance, read_provenance
from nas_data.dataset.read import STAMP_TOLERANCE, Rows, read
from nas_data.dataset.staging import find_leftovers
from nas_data.dataset.transitions import as_transitions
from nas_data.dataset.versions import VERSION, resolve
from nas_data.errors import DatasetInvalid, JointMismatch

STATISTICS_TOLERANCE = 1e-5  # share; LeRobot's statistics pass through float32


@dataclass(frozen=True)
class Findings:
    """Results of a verification, one sentence each.

    Attributes:
        problems: Errors in the dataset.
        notes: Remarks that are not errors.
    """

    problems: tuple[str, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class VerifyInput:
    """Input of the checks.

    Attributes:
        root: The dataset's folder.
        dataset: Its content.
        rows: LeRobot's automatic columns in the order of the episodes.
        provenance: Its provenance; None if it has none.
    """

    root: Path
    dataset: Dataset
    rows: Rows
    provenance: Provenance | None

    @cached_property
    def findings(self) -> tuple[AuditFinding, ...]:
        """Findings of the audits of recordings; empty if no joints are named."""
        try:
            return audit_dataset(as_transitions(self.dataset)[0])
        except (DatasetInvalid, JointMismatch):
            return ()

    @cached_property
    def allowed(self) -> frozenset[str]:
        """Checks that found something at the import: such an error was allowed, else nothing was imported."""
        notes = self.provenance.notes if self.provenance and is_ours(self.provenance) else ""
        return frozenset(line.partition(": ")[0] for line in notes.splitlines())


def verify(root: Path) -> list[str]:
    """Return the problems of a dataset, one sentence each; empty if there are none.

    Raises:
        DatasetNotFound: there is no dataset at the path.
        DatasetInvalid: its `meta/info.json` is damaged or of another format version.
    """
    return list(examine(root).problems)


def examine(path: Path) -> Findings:
    """Return the problems of a dataset and further notes; raises as `verify` does."""
    root = resolve(path)
    DatasetInfo.read(root)
    problems = list(_report_leftovers(root))
    provenance = None
    try:
        provenance = read_provenance(root)
        problems += _check_files(root, provenance)
        automatic = {key: Feature((key,), dtype=dtype) for key, dtype in layout.AUTOMATIC.items()}
        rows = Rows.read(root, automatic)
        rows.sort(root)
        evidence = VerifyInput(root, read(root), rows, provenance)
        for check in PROBLEMS:
            problems += check(evidence)
    except DatasetInvalid as error:
        return Findings((*problems, str(error)), ())
    return Findings(tuple(problems), tuple(note for check in NOTES for note in check(evidence)))


def _report_leftovers(root: Path) -> Iterator[str]:
    """Report hidden folders of killed writers beside this dataset."""
    home = root.resolve()
    for path in find_leftovers(home.parent, "*" if VERSION.fullmatch(home.name) else home.name):
        yield (
            f"{path} is a half-written dataset that a killed process left; it was never part of this one: "
            "rescue what it holds with 'nas recover', or delete it."
        )


def _check_files(root: Path, provenance: Provenance | None) -> Iterator[str]:
    """Compare every file with its SHA-256 in the provenance."""
    if provenance is None:
        yield (
            f"{root / layout.PROVENANCE} is missing: LeRobot wrote or edited this dataset, and its tools do not keep "
            "provenance; any nas command that makes a new version of it (pair, merge, split) starts one."
        )
        return
    for name, digest in sorted(provenance.files.items()):
        if not (root / name).is_file():
            yield f"{root / name} is missing; restore it from a copy."
        elif hashlib.sha256((root / name).read_bytes()).hexdigest() != digest:
            yield f"{root / name} was changed after nas wrote it (its SHA-256 differs)."
    present = [*layout.list_data_files(root), *layout.list_episode_files(root)]
    for path in present:
        if path.relative_to(root).as_posix() not in provenance.files:
            yield f"{path} was added after nas wrote the dataset (LeRobot appended episodes?)."


def _check_content(evidence: VerifyInput) -> Iterator[str]:
    """Compare the content hash with the provenance and the version's name."""
    recorded = evidence.provenance.content_hash if evidence.provenance else None
    digest = choose_content_hash(evidence.dataset, recorded or "")
    if recorded is not None and digest != recorded:
        yield (
            f"The content hash is {digest[:12]}…, provenance says {recorded[:12]}…: rows or features were changed in "
            "place; a changed dataset should be a new version (nas merge, nas pair)."
        )
    version = VERSION.fullmatch(evidence.root.resolve().name)
    if version and not digest.startswith(version.group(2)):
        yield f"The folder is named {version.group(0)}, the content hash begins with {digest[:8]}."


def _check_indices(evidence: VerifyInput) -> Iterator[str]:
    """Check LeRobot's automatic columns against the episodes."""
    dataset, columns = evidence.dataset, evidence.rows.columns
    frame = np.arange(dataset.n_frames) - np.repeat(dataset.starts, dataset.lengths)
    for key, expected in (("frame_index", frame), ("index", np.arange(dataset.n_frames))):
        wrong = np.flatnonzero(columns[key][:, 0] != expected)
        if len(wrong):
            found = int(columns[key][wrong[0], 0])
            yield f"{key} is {found} where {int(expected[wrong[0]])} is expected ({_locate(dataset, wrong[0])})."
    due = (frame / dataset.fps).astype(layout.AUTOMATIC["timestamp"])  # float32: 0.1 ms coarse after half an hour
    off = np.abs(columns["timestamp"][:, 0].astype(np.float64) - due)
    late = np.flatnonzero(off > np.maximum(STAMP_TOLERANCE, np.spacing(due)))
    if len(late):
        yield f"timestamp is not frame_index / fps ({_locate(dataset, late[0])}); LeRobot's loaders rely on it."


def _check_episodes(evidence: VerifyInput) -> Iterator[str]:
    """Check the episode table against the rows."""
    dataset = evidence.dataset
    wanted = ["episode_index", "length", "dataset_from_index", "dataset_to_index"]
    tables = [read_parquet(path, wanted) for path in layout.list_episode_files(evidence.root)]
    if not tables or any(key not in table.column_names for table in tables for key in wanted):
        yield f"{evidence.root / 'meta/episodes'} holds no complete episode table; restore it from a copy."
        return
    table = pa.concat_tables(tables, promote_options="permissive")
    expected = {
        "episode_index": np.arange(dataset.n_episodes),
        "length": dataset.lengths,
        "dataset_from_index": dataset.starts,
        "dataset_to_index": dataset.starts + dataset.lengths,
    }
    for key, values in expected.items():
        found = table[key].to_numpy()
        if len(found) != len(values):
            yield f"meta/episodes lists {count_of(len(found), 'episode')}, the data files hold {len(values)}."
            return
        wrong = np.flatnonzero(found != values)
        if len(wrong):
            yield f"meta/episodes says {key} {found[wrong[0]]} for episode {wrong[0]}, the rows say {values[wrong[0]]}."


def _check_passthrough(evidence: VerifyInput) -> Iterator[str]:
    """Report missing videos or columns; without provenance, a missing file is not detected otherwise."""
    dataset = evidence.dataset
    if dataset.passthrough is None or evidence.provenance is not None:
        return
    try:
        dataset.passthrough.check(dataset.starts, dataset.lengths)
    except DatasetInvalid as error:
        yield str(error)


def _check_statistics(evidence: VerifyInput) -> Iterator[str]:
    """Compare `meta/stats.json`, which policies use for normalisation, with the values."""
    path = evidence.root / layout.STATS
    stats = layout.read_json(path)
    columns = dict(evidence.dataset.columns)
    if TIME in columns and TIME not in DatasetInfo.read(evidence.root).features:  # read from LeRobot's time stamps
        del columns[TIME]
        columns |= {"timestamp": evidence.rows.columns["timestamp"]} if "timestamp" in stats else {}
    for key, column in columns.items():
        entry = stats.get(key)
        exact = {"min": column.min(axis=0), "max": column.max(axis=0)}
        for name, values in exact.items():
            stored = np.asarray(entry.get(name), np.float64).reshape(-1) if isinstance(entry, dict) else np.empty(0)
            allowed = STATISTICS_TOLERANCE * np.maximum(1.0, np.abs(values.astype(np.float64)))
            harm = "" if key == "timestamp" else "; policies would be normalised wrongly"
            if stored.shape != values.shape or (np.abs(stored - values.astype(np.float64)) > allowed).any():
                yield f"The {name} of '{key}' in {path} does not match the data{harm}."


def _report_audit_problems(evidence: VerifyInput) -> Iterator[str]:
    """Report errors of the audits (clock against rate, angles in degrees), and readings stored twice."""
    return (_describe_finding(evidence, finding) for finding in evidence.findings if _is_problem(evidence, finding))


def _report_audit_notes(evidence: VerifyInput) -> Iterator[str]:
    """Note the other findings of the audits."""
    return (_describe_finding(evidence, finding) for finding in evidence.findings if not _is_problem(evidence, finding))


def _describe_finding(evidence: VerifyInput, finding: AuditFinding) -> str:
    """Return a finding with the remedy that the origin of the dataset allows."""
    found = add_remedy(evidence.root, evidence.provenance, finding, evidence.dataset)
    return f"In {found.file} {found.message}"


def _is_problem(evidence: VerifyInput, finding: AuditFinding) -> bool:
    return (finding.error and finding.check not in evidence.allowed) or finding.check == "repeated_time"


def _find_discontinuities(evidence: VerifyInput) -> np.ndarray:
    """Return the frames whose next state is not the following frame's state."""
    dataset = evidence.dataset
    if NEXT_STATE not in dataset.features or STATE not in dataset.features:
        return np.empty(0, np.int64)
    inner = np.ones(dataset.n_frames, bool)
    inner[dataset.starts + dataset.lengths - 1] = False
    rows = np.flatnonzero(inner)
    if dataset.next_states.shape != dataset.states.shape:
        return np.empty(0, np.int64)
    return rows[(dataset.next_states[rows] != dataset.states[rows + 1]).any(axis=1)]


def _check_continuity(evidence: VerifyInput) -> Iterator[str]:
    """Report discontinuous transitions in a recording that its provenance calls contiguous."""
    gaps = _find_discontinuities(evidence)
    if len(gaps) and evidence.provenance is not None and evidence.provenance.contiguous:
        first = _locate(evidence.dataset, gaps[0])
        yield f"In {count_of(len(gaps), 'frame')} the next state is not the following frame's state (first: {first})."


def _note_discontinuities(evidence: VerifyInput) -> Iterator[str]:
    """Note discontinuous transitions in other recordings."""
    gaps = _find_discontinuities(evidence)
    if len(gaps) and not (evidence.provenance is not None and evidence.provenance.contiguous):
        yield (
            f"In {count_of(len(gaps), 'frame')} the next state is not the following frame's state; an open-loop "
            "rollout across them would be wrong."
        )


def _locate(dataset: Dataset, row: np.integer) -> str:
    episode = int(np.searchsorted(dataset.starts, row, side="right")) - 1
    return f"episode {episode}, frame {int(row) - int(dataset.starts[episode])}"


# Checks against values that can be recomputed from the rows.
METADATA: tuple[Callable[[VerifyInput], Iterator[str]], ...] = (_check_indices, _check_episodes, _check_statistics)
PROBLEMS: tuple[Callable[[VerifyInput], Iterator[str]], ...] = (
    _check_content,
    *METADATA,
    _check_passthrough,
    _report_audit_problems,
    _check_continuity,
)
NOTES: tuple[Callable[[VerifyInput], Iterator[str]], ...] = (_report_audit_notes, _note_discontinuities)
