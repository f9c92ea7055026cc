"""The same recording in any format, unit and layout imports to the same dataset; unreadable logs say why."""

import json
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.import_samples import (
    JOINTS,
    RATE,
    columns_of,
    map_text,
    motion,
    sample_map,
    write_log,
    write_map,
)

from nas_data.cli import main
from nas_data.dataset.content import hash_content
from nas_data.dataset.provenance import read_provenance
from nas_data.errors import LogError, MapError
from nas_data.importing.formats import read_table
from nas_data.importing.layout import LogLayout
from nas_data.importing.map_file import load_map
from nas_data.importing.table import LogTable
from nas_data.recorders.logs import import_logs

FORMATS = (".csv", ".parquet", ".npz", ".json")
FACTORS = {"rad": 1.0, "deg": np.pi / 180, "turn": 2 * np.pi, "ticks": 1.0}
VELOCITY_FACTORS = {"rad/s": 1.0, "deg/s": np.pi / 180, "turn/s": 2 * np.pi, "rpm": np.pi / 30, "ticks": 1.0}
TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}


@dataclass(frozen=True)
class Unit:
    """A random way to log an angle or a speed of one joint."""

    name: str
    sign: int
    scale: float
    zero: float
    offset: float

    def log(self, value: np.ndarray, factors: dict[str, float]) -> np.ndarray:
        return (value - self.offset) * self.sign / (factors[self.name] * self.scale) + self.zero

    def toml(self) -> str:
        keys = {"unit": json.dumps(self.name), "sign": self.sign, "scale": self.scale, "zero": self.zero}
        return "\n".join(f"{key} = {value}" for key, value in (keys | self.offset_key()).items())

    def offset_key(self) -> dict[str, object]:
        return {"offset": self.offset} if self.offset else {}


def units(names: dict[str, float], offsets: st.SearchStrategy[float]) -> st.SearchStrategy[Unit]:
    return st.builds(
        Unit,
        st.sampled_from(sorted(names)),
        st.sampled_from([-1, 1]),
        st.sampled_from([1.0, 0.25, 0.0015]),
        st.sampled_from([0.0, 2048.0, -3.5]),
        offsets,
    )


def table(column: str, chosen: list[Unit], section: str) -> str:
    """A quantity's table with a table a joint."""
    joints = [f"[read.{section}.joints.{joint}]\n{unit.toml()}" for joint, unit in zip(JOINTS, chosen, strict=True)]
    return f'column = "{column}"\n' + "\n".join(joints)


@settings(max_examples=20, deadline=None)
@given(
    position=st.lists(units(FACTORS, st.floats(-0.5, 0.5)), min_size=2, max_size=2),
    command=st.lists(units(FACTORS, st.floats(-0.5, 0.5)), min_size=2, max_size=2),
    velocity=st.lists(units(VELOCITY_FACTORS, st.just(0.0)), min_size=2, max_size=2),
    time=st.sampled_from(sorted(TIMES)),
    phase=st.floats(0, 6),
    rows=st.integers(30, 90),
)
def test_any_format_and_unit_imports_to_the_same_dataset(position, command, velocity, time, phase, rows):
    truth = motion(rows, phase=phase)
    columns = {
        "t": (truth.time + 1000.0) / TIMES[time],
        "q": np.column_stack([unit.log(truth.position[:, i], FACTORS) for i, unit in enumerate(position)]),
        "dq": np.column_stack([unit.log(truth.velocity[:, i], VELOCITY_FACTORS) for i, unit in enumerate(velocity)]),
        "goal": np.column_stack([unit.log(truth.command[:, i], FACTORS) for i, unit in enumerate(command)]),
    }
    datasets = []
    with TemporaryDirectory() as name:
        for suffix in FORMATS:
            log = write_log(Path(name) / f"log{suffix}", columns)
            text = map_text(
                suffix,
                time=f'column = "t"\nunit = "{time}"',
                position=table("q", position, "position"),
                register=table("dq", velocity, "velocity"),
                command=table("goal", command, "command"),
                # Whether small motions in degrees are plausible is another test's question.
                extra='[audit]\nallow = ["unit_slip"]',
            )
            datasets.append(import_logs([log], load_map(write_map(Path(name), text))).dataset)
    first = datasets[0]
    assert all(hash_content(dataset) == hash_content(first) for dataset in datasets[1:])
    np.testing.assert_allclose(first.states, np.hstack([truth.position, truth.velocity])[:-1], atol=2e-6)
    np.testing.assert_allclose(first.next_states, np.hstack([truth.position, truth.velocity])[1:], atol=2e-6)
    np.testing.assert_allclose(first.commands, truth.command[:-1], atol=2e-6)
    np.testing.assert_allclose(first.columns["nas.time"][:, 0], truth.time[:-1], atol=1e-9)


@pytest.mark.parametrize("suffix", FORMATS)
def test_each_format_keeps_constants_and_one_column_a_joint(tmp_path, suffix):
    truth = motion()
    columns = {"t": truth.time, "v": np.full(120, 7.4)}
    for i in range(2):
        columns |= {f"q{i}": truth.position[:, i], f"dq{i}": truth.velocity[:, i], f"g{i}": truth.command[:, i]}
    # A CSV file has no place beside its rows: there a column that never changes is a constant.
    constants = {"kp": 100, "motor": "xl320"}
    if suffix == ".csv":
        columns["kp"], constants = np.full(120, 100), {}
    names = ["kp", *(["motor"] if constants else [])]
    log = write_log(tmp_path / f"log{suffix}", columns, constants)
    mapping = sample_map(
        tmp_path,
        suffix,
        '[signals.voltage]\ncolumn = "v"\nwhole_robot = true\nunit = "V"\n'
        '[signals.gain]\nconstant = "kp"\nunit = "register"',
        top=f'constants = {json.dumps(names)}\ntask = "gain {{kp}}"\n'
        + ('entries = "rows"' if suffix == ".json" else ""),
        position='columns = ["q0", "q1"]\nunit = "rad"',
        register='columns = ["dq0", "dq1"]\nunit = "rad/s"',
        command='columns = ["g0", "g1"]\nunit = "rad"',
    )
    result = import_logs([log], mapping)
    dataset = result.dataset
    assert dataset.tasks == ("gain 100",)
    assert result.provenance.target["episodes"][0]["constants"] == {"kp": 100} | constants
    assert dataset.features["nas.voltage"].names == ("voltage",)
    assert dataset.features["nas.gain"].names == ("shoulder.gain", "elbow.gain")
    assert (dataset.columns["nas.gain"] == 100).all()
    np.testing.assert_allclose(dataset.states[:, :2], truth.position[:-1], atol=1e-6)


def import_columns(folder: Path, columns: dict, suffix: str = ".npz", text: str | None = None):
    log = write_log(folder / f"log{suffix}", columns)
    return import_logs([log], load_map(write_map(folder, text or map_text(suffix))))


@pytest.mark.parametrize("suffix", FORMATS)
def test_a_missing_column_is_named_with_those_there_are(tmp_path, suffix):
    columns = columns_of(motion())
    del columns["dq"]
    with pytest.raises(MapError, match=rf"log{suffix} has no column 'dq'.*it has: t, q, goal"):
        import_columns(tmp_path, columns, suffix)


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".npz", ".json"])
def test_a_log_without_rows_is_refused(tmp_path, suffix):
    columns = {key: values[:0] for key, values in columns_of(motion()).items()}
    with pytest.raises((LogError, MapError), match=rf"log{suffix}.*(no rows|no column)"):
        import_columns(tmp_path, columns, suffix)


@pytest.mark.parametrize("suffix", FORMATS)
def test_an_empty_file_is_refused(tmp_path, suffix):
    log = tmp_path / f"log{suffix}"
    log.write_bytes(b"")
    with pytest.raises(LogError, match="is empty; give a log"):
        import_logs([log], sample_map(tmp_path, suffix))


@pytest.mark.parametrize("suffix", FORMATS)
def test_a_file_that_is_something_else_is_refused(tmp_path, suffix):
    log = tmp_path / f"log{suffix}"
    log.write_bytes(bytes(range(256)) * 4)
    with pytest.raises(LogError, match=rf"log{suffix} (cannot be read as|is not an NPZ archive)"):
        import_logs([log], sample_map(tmp_path, suffix))


def test_a_damaged_npz_is_refused(tmp_path):
    log = write_log(tmp_path / "log.npz", columns_of(motion()))
    content = bytearray(log.read_bytes())
    content[300:340] = bytes(40)
    log.write_bytes(content)
    with pytest.raises(LogError, match=r"log.npz is damaged.*restore it from a copy"):
        import_logs([log], sample_map(tmp_path))


def test_a_log_of_another_format_than_the_map_is_refused(tmp_path):
    log = write_log(tmp_path / "log.csv", columns_of(motion()))
    with pytest.raises(LogError, match=r"log.csv does not end in .npz, but the map says format = 'npz'"):
        import_logs([log], sample_map(tmp_path))


def test_too_few_rows_are_refused(tmp_path):
    columns = {key: values[:2] for key, values in columns_of(motion()).items()}
    with pytest.raises(LogError, match=r"has only 2 rows; at least 3 .* nothing remains"):
        import_columns(tmp_path, columns)


def test_arrays_of_different_lengths_are_refused(tmp_path):
    columns = columns_of(motion())
    columns["goal"] = columns["goal"][:-1]
    with pytest.raises(LogError, match="'goal' has 119 rows, but its times are 120"):
        import_columns(tmp_path, columns)


def test_vectors_of_another_width_than_the_joints_are_refused(tmp_path):
    columns = columns_of(motion(joints=3))
    with pytest.raises(LogError, match="'q' has 3 numbers a row, but the map has 2 joints"):
        import_columns(tmp_path, columns)


def test_components_pick_joints_out_of_a_wider_vector(tmp_path):
    truth = motion()
    columns = columns_of(truth) | {"q": np.hstack([truth.velocity, truth.position])}
    text = map_text(position='column = "q"\ncomponents = [2, 3]\nunit = "rad"')
    dataset = import_columns(tmp_path, columns, text=text).dataset
    np.testing.assert_allclose(dataset.states[:, :2], truth.position[:-1], atol=1e-6)
    with pytest.raises(MapError, match="has 4 components, but the map picks number 7"):
        import_columns(tmp_path, columns, text=text.replace("[2, 3]", "[2, 7]"))


def test_text_where_a_number_is_due_is_named_by_row(tmp_path):
    log = write_log(tmp_path / "log.csv", {"t": motion().time} | columns_of(motion()))
    lines = log.read_text().splitlines()
    lines[18] = "soon" + lines[18][lines[18].index(",") :]
    log.write_text("\n".join(lines))
    with pytest.raises(LogError, match=r"column 't' holds 'soon' in row 17 \(line 19 of log.csv\)"):
        import_logs([log], sample_map(tmp_path, ".csv"))


def test_numbers_that_turn_fractional_late_are_not_guessed_from_the_first_rows(tmp_path):
    truth = motion(rows=3000)
    whole = np.concatenate([np.zeros((2000, 2)), truth.position[2000:]])
    columns = {f"q{i}": whole[:, i] for i in range(2)} | columns_of(truth)
    log = write_log(tmp_path / "log.csv", columns)
    log.write_text(log.read_text().replace("\n0.0,0.0,", "\n0,0,"))
    text = map_text(".csv", position='columns = ["q0", "q1"]\nunit = "rad"', extra='[audit]\nallow=["velocity_scale"]')
    dataset = import_logs([log], load_map(write_map(tmp_path, text))).dataset
    np.testing.assert_allclose(dataset.states[:, :2], whole[:-1], atol=1e-6)


@pytest.mark.parametrize(
    ("cell", "message"),
    [
        ('"[0.1]"', r"in row 4 \(line 6 of log.csv\); a JSON list of 2 numbers"),
        ('"[0.1, two]"', r"in row 4 \(line 6 of log.csv\); a JSON list of 2"),
        ('"[0.1, {}]"', r"in row 4 \(line 6 of log.csv\); a JSON list of 2"),
        ("", r"the position is empty, NaN or infinite in row 4 \(line 6 of log.csv\)"),
    ],
)
def test_a_ragged_vector_cell_is_named_by_row(tmp_path, cell, message):
    log = write_log(tmp_path / "log.csv", columns_of(motion()))
    lines = log.read_text().splitlines()
    start, end = lines[5].index('"'), lines[5].index('"', lines[5].index('"') + 1) + 1
    lines[5] = lines[5][:start] + cell + lines[5][end:]
    log.write_text("\n".join(lines))
    with pytest.raises(LogError, match=message):
        import_logs([log], sample_map(tmp_path, ".csv"))


@pytest.mark.parametrize("suffix", [".parquet", ".json"])
def test_ragged_lists_are_named_by_row(tmp_path, suffix):
    columns = {key: values.tolist() for key, values in columns_of(motion()).items()}
    columns["q"][9] = [0.1, 0.2, 0.3]
    log = tmp_path / f"log{suffix}"
    if suffix == ".json":
        log.write_text(
            json.dumps({"rows": [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]})
        )
    else:
        pa.parquet.write_table(pa.table(columns), log)
    with pytest.raises(LogError, match=r"'q' holds 2 numbers in row 0 .* and 3 in row 9 \(counted from 0\)"):
        import_logs([log], sample_map(tmp_path, suffix))


def test_json_with_one_list_a_column_is_read(tmp_path):
    truth = motion()
    log = tmp_path / "log.json"
    log.write_text(json.dumps({key: values.tolist() for key, values in columns_of(truth).items()}))
    dataset = import_logs([log], sample_map(tmp_path, ".json", top="")).dataset
    np.testing.assert_allclose(dataset.commands, truth.command[:-1], atol=1e-6)
    with pytest.raises(MapError, match="no key 'rows', under which the map expects the rows; it has: t, q"):
        import_logs([log], sample_map(tmp_path, ".json"))


@pytest.mark.parametrize("suffix", [".parquet", ".npz", ".csv"])
def test_nanoseconds_since_1970_keep_their_last_digits(tmp_path, suffix):
    steps = np.arange(120) * 20_000_000 + np.arange(120) % 7
    columns = columns_of(motion()) | {"t": 1_790_000_000_123_456_789 + steps}
    dataset = import_columns(tmp_path, columns, suffix, map_text(suffix, time='column = "t"\nunit = "ns"')).dataset
    np.testing.assert_allclose(dataset.columns["nas.time"][:, 0], steps[:-1] * 1e-9, atol=1e-12)


SIGNAL = '[signals.{0}]\ncolumn = "{0}"\nunit = "1"\nwhole_robot = true\n{1}'


def test_signals_that_single_precision_would_change_are_kept_in_double(tmp_path):
    rows = np.arange(120)
    signals = {
        "counts": 20_000_001.0 + rows,
        "clock": 1.76e18 + 2e7 * rows,  # [ns] since 1970, a multiple of the 256 ns that a double resolves
        "epoch": 1.76e9 + 0.02 * rows,
        "millimetres": 20_000_001.0 + rows,
        "load": np.sin(rows),
        "level": 4.0 + rows % 3,
    }
    log = write_log(tmp_path / "log.npz", columns_of(motion()) | signals)
    scales = {"millimetres": "scale = 0.001\n"}
    extra = "".join(SIGNAL.format(name, scales.get(name, "")) for name in signals)
    dataset = import_logs([log], sample_map(tmp_path, extra=extra)).dataset
    stored = {name: dataset.columns[f"nas.{name}"][:, 0] for name in signals}
    for name in ("counts", "clock", "epoch"):
        assert stored[name].dtype == np.float64
        np.testing.assert_array_equal(stored[name], signals[name][:-1])
    np.testing.assert_array_equal(np.rint(stored["millimetres"] / 0.001), signals["millimetres"][:-1])
    assert stored["load"].dtype == stored["level"].dtype == np.float32


def test_dates_are_times_only_where_the_map_says_so(tmp_path):
    columns = {key: values.tolist() for key, values in columns_of(motion()).items()}
    dates = np.datetime64("2026-01-15T10:28:10") + (np.arange(120) * 20_000_000).astype("timedelta64[ns]")
    log = tmp_path / "log.parquet"
    pa.parquet.write_table(pa.table(columns | {"t": pa.array(dates)}), log)
    dated = sample_map(tmp_path, ".parquet", time='column = "t"\nunit = "datetime"')
    np.testing.assert_allclose(import_logs([log], dated).dataset.columns["nas.time"][:, 0], motion().time[:-1])
    with pytest.raises(LogError, match="'t' holds dates or durations; set unit = 'datetime' instead of 's'"):
        import_logs([log], sample_map(tmp_path, ".parquet"))
    text = write_log(tmp_path / "log.csv", columns_of(motion()))
    lines = text.read_text().splitlines()
    cells = [f"{date}Z{line[line.index(',') :]}" for date, line in zip(dates.astype(str), lines[1:], strict=True)]
    text.write_text("\n".join([lines[0], *cells]))
    dated = sample_map(tmp_path, ".csv", time='column = "t"\nunit = "datetime"')
    np.testing.assert_allclose(import_logs([text], dated).dataset.columns["nas.time"][:, 0], motion().time[:-1])


def test_a_log_without_clock_has_evenly_spaced_times_only_where_the_map_says_so(tmp_path):
    columns = columns_of(motion())
    del columns["t"]
    dataset = import_columns(tmp_path, columns, text=map_text(time="uniform = true")).dataset
    np.testing.assert_allclose(dataset.columns["nas.time"][:, 0], np.arange(119) / RATE)
    with pytest.raises(MapError, match="name the time column, or set uniform = true"):
        sample_map(tmp_path, time="")


def test_joint_names_in_the_log_must_be_the_maps(tmp_path):
    columns = columns_of(motion()) | {"names": np.array(JOINTS)}
    import_columns(tmp_path, columns, text=map_text(top='joint_names = "names"'))
    columns["names"] = columns["names"][::-1]
    with pytest.raises(MapError, match=r"has the joints elbow, shoulder, but the map shoulder, elbow; .*in this order"):
        import_columns(tmp_path, columns, text=map_text(top='joint_names = "names"'))


def test_arrays_that_would_have_to_be_unpickled_are_not_read(tmp_path):
    columns = columns_of(motion()) | {"q": np.array([{"harm": 1}] * 120, dtype=object)}
    with pytest.raises(LogError, match=r"'q' holds Python objects, .*save it as numbers"):
        import_columns(tmp_path, columns)


def test_a_constant_that_changes_is_refused(tmp_path):
    columns = columns_of(motion()) | {"kp": np.arange(120)}
    with pytest.raises(LogError, match="'kp' changes within the log"):
        import_columns(tmp_path, columns, text=map_text(top='constants = ["kp"]'))
    with pytest.raises(MapError, match="has no constant 'mass'"):
        import_columns(tmp_path, columns, text=map_text(top='constants = ["mass"]'))


@pytest.mark.parametrize(
    ("suffix", "message"),
    [
        (".npz", "log.npz is cut off: .*copy it again"),
        (".parquet", "log.parquet is cut off: .*copy it again"),
        (".json", "log.json is cut off in line 1; copy it again"),
        (".csv", r"log.csv: line 121 has 2 cells, but the header 4; the line is damaged or cut off"),
    ],
)
def test_a_file_that_is_cut_off_is_said_to_be(tmp_path, suffix, message):
    log = write_log(tmp_path / f"log{suffix}", columns_of(motion()))
    content = log.read_bytes()
    end = content.rstrip().rindex(b',"[', 0, content.rstrip().rindex(b',"[')) if suffix == ".csv" else len(content) // 2
    log.write_bytes(content[:end])
    with pytest.raises(LogError, match=message):
        import_logs([log], sample_map(tmp_path, suffix))


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "latin-1"])
def test_a_csv_in_another_encoding_is_said_to_be(tmp_path, encoding):
    log = write_log(tmp_path / "log.csv", columns_of(motion()))
    text = log.read_text().replace("\n0.02,", "\n0.02\u00b0,")
    log.write_bytes(text.encode(encoding))
    with pytest.raises(LogError, match=r"log.csv cannot be read as csv: it is not in UTF-8; save it in that encoding"):
        import_logs([log], sample_map(tmp_path, ".csv"))


def test_another_delimiter_and_decimal_commas_are_named(tmp_path):
    columns = {f"q{joint}": motion().position[:, joint] for joint in range(2)} | columns_of(motion())
    log = write_log(tmp_path / "log.csv", columns)
    cells = [line.split(",")[:2] for line in log.read_text().splitlines()]
    log.write_text("\n".join(";".join(line) for line in cells))
    with pytest.raises(
        LogError,
        match=r"log.csv separates its columns by ';', but the map by ','; set delimiter = ';' at the top",
    ):
        import_logs([log], sample_map(tmp_path, ".csv"))
    log.write_text("\n".join(";".join(line).replace(".", ",") for line in cells))
    with pytest.raises(LogError, match="set delimiter = ';'"):
        import_logs([log], sample_map(tmp_path, ".csv"))
    text = map_text(".csv", top='delimiter = ";"', time="uniform = true", position='columns=["q0", "q1"]\nunit="rad"')
    with pytest.raises(
        LogError, match=r"in row 0 \(line 2 of log.csv\), which is not a number; if it is one, set decimal = ','"
    ):
        import_logs([log], load_map(write_map(tmp_path, text)))


GERMAN = "delimiter = ';'\ndecimal = ','\nconstants = ['load']\ntask = 'carries {load} kg'"


@pytest.mark.parametrize("clock", ["s", "datetime"])
def test_numbers_times_and_constants_may_have_a_decimal_comma(tmp_path, clock):
    truth = motion()
    times = [f"2024-05-01 12:00:{time:06.3f}" if clock == "datetime" else repr(time) for time in truth.time.tolist()]
    numbers = np.hstack([truth.position, truth.command]).tolist()
    cells = [[time, *map(repr, row)] for time, row in zip(times, numbers, strict=True)]
    lines = ["t;q1;q2;c1;c2;load", *(";".join(row).replace(".", ",") + ";0,25" for row in cells)]
    (tmp_path / "log.csv").write_text("\n".join(lines))
    text = map_text(".csv", top=GERMAN, time=f'column = "t"\nunit = "{clock}"', velocity='"derive"',
                    position='columns = ["q1", "q2"]\nunit = "rad"', command='columns = ["c1", "c2"]\nunit = "rad"',
                    register='columns = ["q1", "q2"]\nunit = "rad/s"')  # fmt: skip
    dataset = import_logs([tmp_path / "log.csv"], load_map(write_map(tmp_path, text))).dataset
    np.testing.assert_allclose(dataset.states[:, :2], truth.position[:-1], atol=1e-6)
    np.testing.assert_allclose(dataset.columns["nas.time"][:, 0], truth.time[:-1], atol=1e-3)
    assert set(dataset.tasks) == {"carries 0.25 kg"}


def test_spaces_around_numbers_are_no_part_of_them(tmp_path):
    (tmp_path / "log.csv").write_text("t, q, n\n0 , 0.5, 1_5\n 1, 1.5 , 2\n")
    table = read_table(tmp_path / "log.csv", LogLayout("csv"))
    assert table.ticks("t", "s").tolist() == [0, 1]
    assert table.numbers("q").tolist() == [[0.5], [1.5]]
    with pytest.raises(LogError, match="holds ' 1_5' in row 0"):
        table.numbers("n")


def test_a_point_between_thousands_is_not_taken_for_a_decimal_one(tmp_path):
    (tmp_path / "log.csv").write_text("t;q\n0,5;1.000\n")
    table = read_table(tmp_path / "log.csv", LogLayout("csv", delimiter=";", decimal=","))
    assert table.numbers("t").tolist() == [[0.5]]
    with pytest.raises(LogError, match=r"holds '1.000' in row 0 .* set decimal = '.'"):
        table.numbers("q")


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_a_header_that_names_a_column_twice_is_refused(tmp_path, suffix):
    columns = columns_of(motion())
    log = tmp_path / f"log{suffix}"
    if suffix == ".csv":
        write_log(log, columns)
        log.write_text(log.read_text().replace("t,q,dq,goal", "t,q,q ,goal", 1))
    else:
        arrays = [pa.array(values.tolist()) for values in columns.values()]
        pa.parquet.write_table(pa.Table.from_arrays(arrays, names=["t", "q", "q", "goal"]), log)
    with pytest.raises(LogError, match=r"has the column 'q' twice, as columns 2 and 3; give each its own name"):
        import_logs([log], sample_map(tmp_path, suffix))


def test_the_same_rows_are_read_however_other_programs_write_them(tmp_path):
    """Duration, decimals, categories and structs of Parquet; nested and line-by-line JSON; arrays on their side."""
    import torch

    given = {key: values.tolist() for key, values in columns_of(motion()).items()}
    right = import_columns(tmp_path, columns_of(motion())).dataset.states
    inside = {"position": 'column = "arm.q"\nunit = "rad"', "top": ""}
    rows = [{"t": t, "arm": {"q": q}, "dq": dq, "goal": goal} for t, q, dq, goal in zip(*given.values(), strict=True)]

    def check(suffix, **changes):
        log = tmp_path / f"log{suffix}"
        found = import_logs([log], load_map(write_map(tmp_path, map_text(suffix, **changes)))).dataset
        np.testing.assert_allclose(found.states, right, atol=2e-3 if suffix == ".pt" else 1e-6)

    (tmp_path / "log.json").write_text(json.dumps(rows), encoding="utf-8-sig")
    check(".json", **inside)
    (tmp_path / "log.json").write_text("\n".join(map(json.dumps, rows)))
    check(".json", **inside)
    first, second = np.transpose(given["q"])
    columns = {
        "t": pa.array([round(t * 1e6) for t in given["t"]]).cast(pa.duration("us")),
        "arm": pa.array([{"q1": q} for q in first]),
        "q2": pa.array([str(q) for q in second]).dictionary_encode(),
        "dq": given["dq"],
        "goal": given["goal"],
    }
    pa.parquet.write_table(pa.table(columns), tmp_path / "log.parquet")
    lasting = 'column = "t"\nunit = "datetime"'
    check(".parquet", time=lasting, position='columns = ["arm.q1", "q2"]\nunit = "rad"')
    columns |= {"q1": pa.array(first).cast(pa.decimal128(12, 9), safe=False)}
    pa.parquet.write_table(pa.table(columns), tmp_path / "log.parquet")
    check(".parquet", time=lasting, position='columns = ["q1", "q2"]\nunit = "rad"')
    np.savez(tmp_path / "log.npz", **{key: np.atleast_2d(np.transpose(values)) for key, values in given.items()})
    check(".npz")
    tensors = {key: torch.tensor(values) for key, values in given.items()}
    tensors |= {"q": tensors["q"].bfloat16(), "dq": tensors["dq"].to_sparse()}
    torch.save(tensors, tmp_path / "log.pt")
    check(".pt")


def test_days_and_dates_as_categories_are_times():
    texts = pa.array(["2025-12-31T23:59:59", "2026-01-01T00:00:00"]).dictionary_encode()
    days = pa.array([20_453, 20_454], pa.date32())
    table = LogTable(Path("log"), {"text": texts, "parts": pa.chunked_array([texts]), "day": days})
    ticks = {name: table.ticks(name, "datetime") for name in table.columns}
    assert {name: int(found[1] - found[0]) for name, found in ticks.items()} == {
        "text": 10**9, "parts": 10**9, "day": 86_400 * 10**9,
    }  # fmt: skip


def test_a_date_may_have_a_decimal_comma_and_others_are_shown(tmp_path):
    columns = columns_of(motion())
    log = write_log(tmp_path / "log.csv", columns)
    header, *lines = log.read_text().splitlines()
    dated = sample_map(tmp_path, ".csv", time='column = "t"\nunit = "datetime"')
    for date in ("2026-01-15 10:28:0{:.3f}", "15.01.2026 10:28:0{:.3f}"):
        stamps = [f'"{date.format(t)}"'.replace(".", ",") if date[0] == "2" else date.format(t) for t in columns["t"]]
        cells = [f"{stamp},{line.partition(',')[2]}" for stamp, line in zip(stamps, lines, strict=True)]
        log.write_text("\n".join([header, *cells]))
        if date[0] == "2":
            times = import_logs([log], dated).dataset.columns["nas.time"][:, 0]
            np.testing.assert_allclose(times, columns["t"][:-1], atol=1e-6)
    with pytest.raises(
        LogError, match=r"holds no dates, such as '15\.01\.2026 10:28:00\.000'; write them as 2025-12-31T"
    ):
        import_logs([log], dated)


def test_lines_before_the_header_and_below_it_are_to_be_taken_out(tmp_path):
    log = write_log(tmp_path / "log.csv", {"t": motion().time, "q": motion().position[:, 0]})
    header, *lines = log.read_text().splitlines()
    log.write_text("\n".join(["# recorded on Monday", header, *lines]))
    with pytest.raises(LogError, match=r"but the header, line 1, has 1; remove lines before the header"):
        import_logs([log], sample_map(tmp_path, ".csv"))
    log.write_text("\n".join([header, "s,rad", *lines]))
    with pytest.raises(
        LogError, match=r"'s' in row 0 \(line 2 of log\.csv\) and numbers below it; if .* units, remove"
    ):
        import_logs([log], sample_map(tmp_path, ".csv"))


@pytest.mark.parametrize("vector", [False, True])
def test_a_line_of_units_below_the_header_is_named(tmp_path, vector):
    columns = {"t": motion().time, "q": motion().position if vector else motion().position[:, 0]}
    log = write_log(tmp_path / "log.csv", columns)
    header, *lines = log.read_text().splitlines()
    log.write_text("\n".join([header, "[s],[rad]", *lines]))
    table = read_table(log, LogLayout("csv"))
    for name in ("t", "q"):
        with pytest.raises(
            LogError, match=r"in row 0 \(line 2 of log\.csv\) and numbers below it; if that row has units"
        ):
            table.numbers(name)


def test_a_decimal_comma_in_the_first_row_is_no_line_of_units(tmp_path):
    (tmp_path / "log.csv").write_text("t;q\n0,5;1\n1;2\n")
    with pytest.raises(LogError, match="set decimal = ','"):
        read_table(tmp_path / "log.csv", LogLayout("csv", delimiter=";")).numbers("t")


def test_true_and_false_are_1_and_0_in_text_too(tmp_path):
    (tmp_path / "log.csv").write_text("t,on\n0,True\n1,\n2,false\n")
    np.testing.assert_array_equal(
        read_table(tmp_path / "log.csv", LogLayout("csv")).numbers("on"), [[1], [np.nan], [0]]
    )


def test_a_column_without_a_number_is_not_to_be_mended_row_by_row(tmp_path):
    (tmp_path / "log.csv").write_text("t,q\n0,1 rad\n1,2 rad\n")
    with pytest.raises(LogError, match=r"'1 rad' .* no row has one: name another column, or write plain numbers"):
        read_table(tmp_path / "log.csv", LogLayout("csv")).numbers("q")


STAMPS = 1_760_000_000_123_456_789 + np.arange(120) * 20_000_000  # [ns]
DATES = np.datetime_as_string(STAMPS.astype("datetime64[ns]")).tolist()


def missing(values: list[object]) -> list[object]:
    """The values without that of row 5."""
    return [None if row == 5 else value for row, value in enumerate(values)]


@pytest.mark.parametrize(
    ("unit", "suffix", "times"),
    [
        ("ns", ".parquet", pa.array(missing(STAMPS.tolist()))),
        ("ns", ".csv", missing(STAMPS.tolist())),
        ("datetime", ".parquet", pa.array(missing(STAMPS.tolist()), pa.timestamp("ns"))),
        ("datetime", ".csv", missing(DATES)),
        ("s", ".csv", missing(motion().time.tolist())),
    ],
)
def test_rows_without_a_time_are_named(tmp_path, unit, suffix, times):
    log = tmp_path / f"log{suffix}"
    if suffix == ".csv":
        log.write_text("t,q\n" + "".join(f"{'' if time is None else time},0\n" for time in times))
    else:
        pa.parquet.write_table(pa.table({"t": times}), log)
    with pytest.raises(LogError, match=r"'t' is empty in row 5 \(.*; remove"):
        read_table(log, LogLayout(suffix[1:])).ticks("t", unit)


def test_dates_without_their_unit_are_answered_with_it(tmp_path):
    (tmp_path / "log.csv").write_text("t\n" + "\n".join(DATES))
    with pytest.raises(LogError, match="'t' holds dates or durations; set unit = 'datetime' instead of 's'"):
        read_table(tmp_path / "log.csv", LogLayout("csv")).ticks("t", "s")


@pytest.mark.parametrize("kind", [pa.large_string(), pa.string_view(), pa.dictionary(pa.int32(), pa.string())])
def test_every_kind_of_text_in_arrow_is_text(kind):
    texts = {"date": DATES, "ns": [str(stamp) for stamp in STAMPS], "q": [str(float(row)) for row in range(120)]}
    plain = {name: pa.array(values) for name, values in texts.items()}
    table = LogTable(Path("log.parquet"), {name: column.cast(kind) for name, column in plain.items()})
    np.testing.assert_array_equal(table.ticks("date", "datetime"), STAMPS)
    np.testing.assert_array_equal(table.ticks("ns", "ns"), STAMPS)
    np.testing.assert_array_equal(table.numbers("q")[:, 0], np.arange(120))


CONSTANTS = {
    "date": (np.array("2026-01-15T10:28:10", "datetime64[ns]"), "2026-01-15T10:28:10.000000000"),
    "bytes": (np.bytes_(b"xl320"), "xl320"),
    "NaN": (np.array(np.nan), None),
    "NaN in every row": (np.full(120, np.nan), None),
    "date in every row": (np.full(120, np.datetime64("2026-01-15")), "2026-01-15"),
}


@pytest.mark.parametrize("name", CONSTANTS)
def test_constants_are_stored_as_json_can_hold_them(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    value, stored = CONSTANTS[name]
    write_log(tmp_path / "log.npz", columns_of(motion()) | {"held": value})
    write_map(tmp_path, map_text(top='constants = ["held"]'))
    assert main(["import", "log.npz", "--map", "map.toml", "--out", "done"]) == 0
    (episode,) = read_provenance(tmp_path / "done").target["episodes"]
    assert episode["constants"] == {"held": stored}
