"""Reading of a log by its map: files become tables, joined on time; tables become SI quantities and recordings."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from nas_data.count_of import count_of
from nas_data.dataset.audits.base import AuditFinding
from nas_data.dataset.audits.finite import name_absent
from nas_data.dataset.audits.timing import find_holes
from nas_data.dataset.features import EFFORT, POSITION, VELOCITY, are_generated
from nas_data.dataset.recording import Recording
from nas_data.errors import LogError, MapError
from nas_data.importing.conversion import TIME_UNITS, decode
from nas_data.importing.formats import find_folder_kind, read_table, read_tables
from nas_data.importing.joining import find_common_rows, join_table, report_ends
from nas_data.importing.map import LogColumns, LogQuantity, Map
from nas_data.importing.messages import RECEIVED
from nas_data.importing.naming import arrange, find_names_column
from nas_data.importing.table import LogTable

MIN_ROWS = 3  # least number of rows, for two transitions
TOO_SHORT = "too_short"  # check of the findings on such episodes
LONGEST_WAY = 0.5  # [s] longest transport delay of a message; a larger difference is one of clocks
SUFFIXES = {"position": POSITION, "velocity": VELOCITY, "effort": EFFORT}  # suffixes of component names


def read_log(log: Path, mapping: Map) -> tuple[list[Recording], list[AuditFinding]]:
    """Read the episodes of a log; too short ones are left out.

    Args:
        log: A file, or a folder if the map names several files.
        mapping: The map.

    Returns:
        Recordings before alignment and resampling, and findings on what is left out.

    Raises:
        LogError: a file is unreadable or empty, or its columns do not match.
        MapError: the map names a column or topic that the log lacks.
    """
    tables = _read_tables(log, mapping)
    reference = tables[mapping.position.source.table]
    times = _read_times(tables, mapping)
    time = times[mapping.position.source.table]
    if not len(time):
        raise LogError(f"{reference.path} holds no rows; give a log with recorded rows.")
    partners = {
        key: join_table(time, times[key], tables[key], mapping, key)
        for key in tables
        if key != mapping.position.source.table
    }
    shared = slice(None)
    findings = []
    if partners:
        matches = {tables[key].path: rows for key, rows in partners.items()}
        shared = find_common_rows(matches, log, reference, mapping.layout)
        findings = report_ends(matches, shared, log, reference, time, mapping.layout.tolerance)

    def read(quantity: LogQuantity) -> np.ndarray:
        raw = []
        for source in quantity.source.parts:
            rows = partners.get(source.table)
            values = _read_raw(tables[source.table], quantity, source, mapping.joints, len(times[source.table]))
            raw.append((values if rows is None else values[rows])[shared])
        return quantity.conversion.apply(decode(np.hstack(raw), quantity.encoding))

    whole = Recording(
        file=str(log),
        episode="",
        joints=mapping.joints,
        time=time[shared] - time[shared][0],
        positions=read(mapping.position),
        velocities=read(mapping.velocity) if mapping.velocity else None,
        commands=read(mapping.command),
        signals={name: read(signal) for name, signal in mapping.signals.items()},
        rows=np.arange(len(time))[shared],
        lines=reference.lines,
    )
    episodes = _split(whole, tables, mapping) if mapping.episode else [whole]
    episodes = [
        replace(part, constants={name: _read_constant(tables, name, mapping, part.rows) for name in mapping.constants})
        for part in episodes
    ]
    if reference.rows is not None:
        episodes = [replace(part, rows=reference.rows[part.rows]) for part in episodes]
    recordings = [part for episode in episodes for part in divide_at_gaps(episode, mapping.rate)]
    findings += [report_short(part) for part in recordings if len(part) < MIN_ROWS]
    return [part for part in recordings if len(part) >= MIN_ROWS], findings


def refuse_nothing(recordings: Sequence[Recording], findings: Sequence[AuditFinding]) -> None:
    """Raise LogError if no recording remains; the message has the reason for the first one that is left out."""
    if not recordings:
        raise LogError(
            next(f"{one.file}: {one.what}, and nothing remains." for one in findings if one.check == TOO_SHORT)
        )


def divide_at_gaps(recording: Recording, rate: float) -> list[Recording]:
    """Divide a recording where rows are missing: a transition across a gap would be a jump.

    Args:
        recording: Episode as recorded.
        rate: Rate in the map [Hz]; the median step is used if rows are slower.

    Returns:
        Parts between the gaps, as episodes numbered from 1; the recording itself if there is no gap.
    """
    steps = np.diff(recording.time)
    # Decreasing or repeated times also look like gaps; the timing audit refuses them.
    if not (steps >= 0).all() or not steps.any():
        return [recording]
    period = max(1 / rate, float(np.median(steps[steps > 0])))
    holes = np.flatnonzero(find_holes(steps, period)) + 1
    if not holes.size:
        return [recording]
    edges = [0, *holes.tolist(), len(recording)]
    name = f"{recording.episode}." if recording.episode else ""
    gaps = [0.0, *steps[holes - 1].tolist()]
    return [
        replace(recording.take(slice(start, stop)), episode=f"{name}{number}", gap=gap)
        for number, (gap, (start, stop)) in enumerate(zip(gaps, pairwise(edges), strict=True), start=1)
    ]


def report_short(recording: Recording, when: str = "", least: int = MIN_ROWS) -> AuditFinding:
    """Return the finding on an episode that is left out because it has too few rows.

    Args:
        recording: The episode.
        when: After which step, in words.
        least: Fewest rows of an episode then.
    """
    what = f"the episode of {recording.name_rows(recording.rows)} has only {count_of(len(recording), 'row')}{when}"
    if recording.gap:
        what += f", before which {recording.gap:.3g} s are missing"
    what += f"; at least {least} are needed, so it is left out"
    return AuditFinding(TOO_SHORT, recording.label, what, rows=tuple(recording.rows.tolist()))


def _read_tables(log: Path, mapping: Map) -> dict[str, LogTable]:
    """Read the log's files, by the keys of `[files]`."""
    files = mapping.layout.files
    if files is None:
        if log.is_dir() and not find_folder_kind(mapping.layout.format):
            raise LogError(
                f"{log} is a folder, but the map reads single {mapping.layout.format} files; give the files."
            )
        tables = read_tables(log, mapping.layout)
        named = {key for key, table in tables.items() if find_names_column(table, mapping)}
        return {key: arrange(table, _restrict(mapping, key), key, required=not named) for key, table in tables.items()}
    if not log.is_dir():
        raise LogError(
            f"{log} is not a folder, but the map reads {', '.join(files.values())} from a folder; give the folder."
        )
    read = {key: read_table(log / name, mapping.layout) for key, name in files.items()}
    where = mapping.position.source.table
    return {key: arrange(table, _restrict(mapping, key), key, required=key == where) for key, table in read.items()}


def _restrict(mapping: Map, table: str) -> Map:
    """Return the map of the single joint in a table if each joint has a table of its own; else the map."""
    tables = next((one.source.tables for one in mapping.quantities if table in one.source.tables), None)
    return replace(mapping, joints=(mapping.joints[tables.index(table)],)) if tables else mapping


def _read_times(tables: dict[str, LogTable], mapping: Map) -> dict[str, np.ndarray]:
    """Read the times of each table [s], relative to the first row of the position table."""
    reference = mapping.position.source.table
    if not mapping.clock.column:
        counts = {key: len(table.numbers(_select_column(mapping, key))) for key, table in tables.items()}
        if len(set(counts.values())) > 1:
            rows = ", ".join(f"{tables[key].path.name} {count}" for key, count in counts.items())
            raise MapError(
                f"{tables[reference].path.parent}: the files are read without times but have different numbers of rows "
                f"({rows}); give them equally many rows, or name their time column in [read.time]."
            )
        return {key: np.arange(count) / mapping.rate for key, count in counts.items()}
    clock = mapping.clock
    ticks = {key: table.ticks(clock.columns.get(key, clock.column), clock.unit) for key, table in tables.items()}
    _refuse_other_clocks(tables, ticks, mapping)
    finite = ticks[reference][np.isfinite(ticks[reference])]
    origin = finite[0] if len(finite) else 0
    return {key: (values - origin) * TIME_UNITS[mapping.clock.unit] for key, values in ticks.items()}


def _refuse_other_clocks(tables: dict[str, LogTable], ticks: dict[str, np.ndarray], mapping: Map) -> None:
    """Raise LogError for topics whose times differ by more than any transport delay: their clocks differ."""
    if mapping.clock.unit != "ns" or not all(RECEIVED in table.columns for table in tables.values()):
        return
    reference = mapping.position.source.table
    ahead = {key: float(np.median(ticks[key] - table.ticks(RECEIVED, "ns"))) for key, table in tables.items()}
    for key, table in tables.items():
        seconds = (ahead[key] - ahead[reference]) * TIME_UNITS["ns"]
        if abs(seconds) > LONGEST_WAY:
            raise LogError(
                f"{table.path}: the times that [read.time] names are {abs(seconds):.3g} s "
                f"{'ahead of' if seconds > 0 else 'behind'} those of {mapping.layout.topics[reference]}, "
                f"compared with the times of receipt; set column = '{RECEIVED}' for all topics: all times of receipt "
                "come from one clock."
            )


def _select_column(mapping: Map, table: str) -> str:
    """Return a column that the map reads from a table."""
    return mapping.find_parts(table)[0].columns[0]


def _read_raw(
    table: LogTable, quantity: LogQuantity, source: LogColumns, joints: Sequence[str], count: int
) -> np.ndarray:
    """Read the raw values of a quantity, or of its part in a table, shape (N, n).

    Args:
        table: The file or topic.
        quantity: The whole quantity.
        source: Its columns, or those of one joint.
        joints: The map's joints.
        count: Number of times in the table, N.
    """
    width = 1 if quantity.source.tables else len(quantity.conversion.gain)
    there = table.names.get(source.columns[0]) if len(source.columns) == 1 else None
    if width == len(joints) and there is not None:
        source = match_components(table.path, quantity, source, joints, there)
    raw = _read_source(table, quantity.name, source, width, count)
    if len(raw) != count:
        raise LogError(
            f"{table.path}: '{source.columns[0]}' has {count_of(len(raw), 'row')}, but its times are {count}; "
            "they must be equally many."
        )
    if quantity.encoding:
        _check_register(table, quantity.encoding, source, raw)
    return raw


def match_components(
    path: Path, quantity: LogQuantity, source: LogColumns, joints: Sequence[str], there: Sequence[str]
) -> LogColumns:
    """Find the components of a quantity by name.

    Args:
        path: The log.
        quantity: The whole quantity.
        source: Its column, or that of one joint.
        joints: The map's joints.
        there: Names of the column's components in the log.

    Raises:
        MapError: a joint is missing; the message lists the available names.
    """
    if source.components or (not source.names and are_generated(source.columns[0], there)):
        return source
    suffixes = [SUFFIXES.get(kind) for kind in quantity.conversion.kinds]
    if None in suffixes and not source.names:
        owners = [name.rpartition(".")[0] or name for name in there]  # of a signal such as j1.load
        same = sorted(owners) == sorted(joints)
        return replace(source, components=tuple(map(owners.index, joints))) if same else source
    ended = zip(joints, suffixes, strict=True)
    wanted = source.names or tuple(joint if joint in there else f"{joint}{suffix}" for joint, suffix in ended)
    missing = next((name for name in wanted if name not in there), None)
    if missing is not None:
        raise MapError(
            f"{path}: '{source.columns[0]}' has no component '{missing}'; it has: {', '.join(there)}. "
            f"Name them in 'joints' of the map, or with names = […] in [read.{quantity.name}]."
        )
    return replace(source, components=tuple(there.index(name) for name in wanted))


def _read_source(table: LogTable, name: str, source: LogColumns, width: int, count: int) -> np.ndarray:
    """Read raw numbers, shape (N, n)."""
    if source.constant:
        value = table.constant(source.columns[0])
        if isinstance(value, str) or not np.isscalar(value):
            raise LogError(
                f"{table.path}: the constant '{source.columns[0]}' is {value!r}, not a number; name a number in "
                "the map."
            )
        return np.full((count, width), float(str(value)))
    parts = [table.numbers(name) for name in source.columns]
    if len(parts) > 1:
        vectors = [name for name, part in zip(source.columns, parts, strict=True) if part.shape[1] != 1]
        if vectors or len({len(part) for part in parts}) > 1:
            name = vectors[0] if vectors else source.columns[-1]
            raise LogError(
                f"{table.path}: '{name}' does not have one number per row, unlike the other columns named with it; "
                "name columns with one number per row in 'columns', or one of vectors in 'column'."
            )
        return np.hstack(parts)
    raw = parts[0]
    if len(raw) and (raw.size == 0 or (raw.shape[1] != width and np.isnan(raw).all())):
        raise LogError(f"{table.path}: '{source.columns[0]}' is empty in all rows; {name_absent(name)}.")
    if source.components:
        if max(source.components) >= raw.shape[1]:
            raise MapError(
                f"{table.path}: '{source.columns[0]}' has {count_of(raw.shape[1], 'component')}, "
                f"but the map picks number {max(source.components)} (they count from 0); "
                "correct 'components'."
            )
        return raw[:, list(source.components)]
    if raw.shape == (width, count) != (count, width):
        return raw.T  # one row per joint, as in MATLAB and some simulators
    if raw.shape[1] != width:
        raise LogError(
            f"{table.path}: '{source.columns[0]}' has {count_of(raw.shape[1], 'number')} a row, but the map has "
            f"{count_of(width, 'joint')}; "
            "correct 'joints', or pick with 'components'."
        )
    return raw


def _check_register(table: LogTable, encoding: str, source: LogColumns, raw: np.ndarray) -> None:
    """Refuse counts that exceed the width of the register."""
    wide = encoding.startswith("int")
    bits = int(encoding.removeprefix("int").removeprefix("sign_magnitude_")) + (0 if wide else 1)
    bad = np.flatnonzero(((raw < 0) | (raw >= 2**bits)).any(axis=1))
    if bad.size:
        raise LogError(
            f"{table.path}: '{source.columns[0]}' in {table.name_rows(bad)} is not within 0 … {2**bits - 1}, "
            f"so it is no {encoding} register read as unsigned; remove 'encoding' from the map."
        )


def _read_constant(tables: dict[str, LogTable], name: str, mapping: Map, rows: np.ndarray) -> object:
    """Return a constant of the log or episode, from the file that contains it."""
    for key, table in tables.items():
        if name in table.constants or name in table.columns:
            return table.constant(name, rows if key == mapping.position.source.table else slice(None))
    return tables[mapping.position.source.table].constant(name)


def _split(whole: Recording, tables: dict[str, LogTable], mapping: Map) -> list[Recording]:
    """Split a log where its episode column changes."""
    assert mapping.episode is not None
    table = tables[mapping.episode.table]
    column = table.column(mapping.episode.columns[0])
    values: np.ndarray = np.asarray(column if isinstance(column, np.ndarray) else column.to_pylist())
    if mapping.episode.table != mapping.position.source.table or values.ndim != 1:
        raise MapError(
            f"{table.path}: the episode column must stand in the file with the positions, one value a row; name such a "
            "column in [read.episode]."
        )
    values = values[whole.rows]
    breaks = [0, *(np.flatnonzero(values[1:] != values[:-1]) + 1).tolist(), len(values)]
    firsts = [values[start] for start in breaks[:-1]]
    if len(set(firsts)) < len(firsts):
        raise LogError(
            f"{table.path}: the episode '{next(v for v in firsts if firsts.count(v) > 1)}' appears again after another "
            "one; sort the rows, or give each episode its own number."
        )
    parts = (whole.take(slice(start, stop)) for start, stop in pairwise(breaks))
    return [replace(part, episode=str(value)) for part, value in zip(parts, firsts, strict=True)]
