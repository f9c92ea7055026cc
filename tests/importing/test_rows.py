"""From rows to transitions: joining tables on time, alignment, episodes, resampling, derived velocities."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.import_samples import RATE, columns_of, map_text, motion, sample_map, write_log, write_map

from nas_data.dataset.recording import Recording
from nas_data.dataset.rows import TextLines, find_row_spans, format_rows
from nas_data.errors import LogError, MapError
from nas_data.importing.formats import read_table
from nas_data.importing.joining import _measure_half_steps, match_rows
from nas_data.importing.layout import LogLayout
from nas_data.importing.map import Resample
from nas_data.importing.map_file import load_map
from nas_data.importing.resampling import resample
from nas_data.recorders.logs import import_logs

TWO_FILES = '[files]\nstate = "state.csv"\ncontrol = "control.csv"\n[join]\nmethod = "{}"\ntolerance = 0.01'


def two_file_map(folder: Path, method: str = "nearest") -> Path:
    return write_map(
        folder,
        map_text(
            ".csv",
            top=TWO_FILES.format(method),
            position='file = "state"\ncolumn = "q"\nunit = "rad"',
            register='file = "state"\ncolumn = "dq"\nunit = "rad/s"',
            command='file = "control"\ncolumn = "goal"\nunit = "rad"',
        ),
    )


def two_files(folder: Path, control: slice = slice(None), shift: float = 0.0) -> Path:
    """A log of two files whose control rows are shifted in time or cut."""
    columns = columns_of(motion())
    log = folder / "log"
    log.mkdir(exist_ok=True)
    write_log(log / "state.csv", {key: columns[key] for key in ("t", "q", "dq")})
    goal = {"t": columns["t"][control] + shift, "goal": columns["goal"][control]}
    write_log(log / "control.csv", goal)
    return log


times = st.lists(st.integers(0, 1000), min_size=1, max_size=40).map(lambda values: np.sort(np.array(values)) / 100)


@given(wanted=times, given_=times, method=st.sampled_from(["nearest", "previous"]), tolerance=st.floats(0.001, 3))
def test_joined_rows_are_the_nearest_or_the_last_before(wanted, given_, method, tolerance):
    rows = match_rows(wanted, given_, method, tolerance)
    for time, row in zip(wanted, rows, strict=True):
        candidates = given_ if method == "nearest" else given_[given_ <= time]
        distances = np.abs(candidates - time)
        if not len(distances) or distances.min() > tolerance:
            assert row == -1
        else:
            assert abs(given_[row] - time) == distances.min()


def test_rows_of_the_same_times_are_joined_to_each_other_however_uneven_they_are():
    """The middle of a short step is before the next row, that of a long one no later than of a usual one."""
    time = np.cumsum(0.02 + 0.012 * np.random.default_rng(0).uniform(-1, 1, 500))
    rows = match_rows(time, time, "previous", 0.1, _measure_half_steps(time))
    np.testing.assert_array_equal(rows, np.arange(500))


@pytest.mark.parametrize("method", ["nearest", "previous"])
def test_two_files_are_joined_on_time(tmp_path, method):
    truth = motion()
    result = import_logs([two_files(tmp_path, shift=-0.004)], load_map(two_file_map(tmp_path, method)))
    np.testing.assert_allclose(result.dataset.commands, truth.command[:-1], atol=1e-6)
    # A folder of such folders holds them as logs.
    assert import_logs([tmp_path], load_map(two_file_map(tmp_path))).dataset.n_frames == 119


def test_rows_without_partner_at_the_ends_are_left_out(tmp_path):
    truth = motion()
    result = import_logs([two_files(tmp_path, slice(5, -3))], load_map(two_file_map(tmp_path)))
    np.testing.assert_allclose(result.dataset.commands, truth.command[5:-4], atol=1e-6)
    np.testing.assert_allclose(result.dataset.states[:, :2], truth.position[5:-4], atol=1e-6)
    assert result.dataset.columns["nas.time"][0] == 0
    first, last = result.findings
    assert first.rows == (0, 1, 2, 3, 4) and last.rows == (117, 118, 119) and first.check == "unmatched_ends"
    assert first.message == (
        "the first 0.1 s, rows 0–4 (lines 2–6 of state.csv), have nothing in control.csv within 0.01 s and are "
        "left out."
    )
    assert last.message.startswith("the last 0.06 s, rows 117–119")


def test_a_log_without_commands_for_half_of_its_time_is_refused(tmp_path):
    log, path = two_files(tmp_path, slice(5, 60)), two_file_map(tmp_path)
    said = r"the first 0.1 s, .*; add allow = \['unmatched_ends'\] .* or raise the tolerance of \[join\].* And 1 more"
    with pytest.raises(LogError, match=said):
        import_logs([log], load_map(path))
    path.write_text(path.read_text() + '[audit]\nallow = ["unmatched_ends"]\n')
    result = import_logs([log], load_map(path))
    assert result.dataset.n_frames == 54 and {finding.check for finding in result.findings} == {"unmatched_ends"}


def test_rows_without_partner_in_the_middle_are_refused(tmp_path):
    log = two_files(tmp_path)
    lines = (log / "control.csv").read_text().splitlines()
    (log / "control.csv").write_text("\n".join(lines[:40] + lines[43:]))
    with pytest.raises(
        LogError, match=r"control.csv has nothing within 0.01 s of rows 39–41 \(lines 41–43 of state.csv\)"
    ):
        import_logs([log], load_map(two_file_map(tmp_path)))


def test_files_of_other_times_are_refused(tmp_path):
    with pytest.raises(LogError, match=r"no row of control.csv is within 0.01 s of a measured state"):
        import_logs([two_files(tmp_path, shift=100.0)], load_map(two_file_map(tmp_path)))


def test_a_second_file_whose_time_goes_back_or_that_is_empty_is_refused(tmp_path):
    with pytest.raises(
        LogError,
        match=r"control.csv: the time decreases or is not a number in rows 1–119 \(lines 3–121 of control.csv\)",
    ):
        import_logs([two_files(tmp_path, slice(None, None, -1))], load_map(two_file_map(tmp_path)))
    with pytest.raises(LogError, match=r"control.csv holds no rows"):
        import_logs([two_files(tmp_path, slice(0, 0))], load_map(two_file_map(tmp_path)))


def test_a_missing_second_file_is_named(tmp_path):
    log = two_files(tmp_path)
    (log / "control.csv").unlink()
    with pytest.raises(LogError, match=r"There is no file .*control.csv"):
        import_logs([log], load_map(two_file_map(tmp_path)))


def test_a_file_where_a_folder_is_due_and_the_reverse_are_refused(tmp_path):
    log = two_files(tmp_path)
    with pytest.raises(
        LogError, match=r"state.csv is not a folder, but the map reads state.csv, control.csv from a folder"
    ):
        import_logs([log / "state.csv"], load_map(two_file_map(tmp_path)))
    (tmp_path / "none").mkdir()
    with pytest.raises(LogError, match=r"none holds no log \(state.csv or control.csv\)"):
        import_logs([tmp_path / "none"], load_map(two_file_map(tmp_path)))
    with pytest.raises(LogError, match=r"none holds no log \(.npz\)"):
        import_logs([tmp_path / "none"], sample_map(tmp_path))
    with pytest.raises(LogError, match=r"There is no log .*nowhere"):
        import_logs([tmp_path / "nowhere"], sample_map(tmp_path))


def test_a_log_named_twice_is_refused(tmp_path):
    log = write_log(tmp_path / "log.npz", columns_of(motion()))
    with pytest.raises(LogError, match="is given twice"):
        import_logs([log, tmp_path], sample_map(tmp_path))


def test_the_pattern_chooses_the_logs_of_a_folder(tmp_path):
    for name in ("run_2.npz", "run_1.npz", "parameters.npz"):
        write_log(tmp_path / name, columns_of(motion()))
    dataset = import_logs([tmp_path], sample_map(tmp_path, top='pattern = "run_*"')).dataset
    assert dataset.tasks == ("run_1", "run_2")


def test_alignment_decides_which_command_belongs_to_a_state(tmp_path):
    truth = motion()
    log = write_log(tmp_path / "log.npz", columns_of(truth))
    follows = import_logs([log], sample_map(tmp_path)).dataset
    np.testing.assert_allclose(follows.commands, truth.command[:-1], atol=1e-6)
    answers = import_logs([log], sample_map(tmp_path, alignment='"state_follows_action"')).dataset
    # state[i], then command i+1 acts, which state[i+1] answers; the last state has no command after it.
    np.testing.assert_allclose(answers.states[:, :2], truth.position[:-2], atol=1e-6)
    np.testing.assert_allclose(answers.commands, truth.command[1:-1], atol=1e-6)
    np.testing.assert_allclose(answers.next_states[:, :2], truth.position[1:-1], atol=1e-6)


@pytest.mark.parametrize("suffix", [".csv", ".npz"])
def test_an_episode_column_divides_a_log(tmp_path, suffix):
    truth = motion()
    columns = columns_of(truth) | {"take": np.repeat([3, 1, 2], [40, 50, 30])}
    log = write_log(tmp_path / f"log{suffix}", columns)
    result = import_logs([log], sample_map(tmp_path, suffix, '[read.episode]\ncolumn = "take"'))
    dataset = result.dataset
    assert dataset.lengths.tolist() == [39, 49, 29]
    assert dataset.tasks == ("log:3", "log:1", "log:2")
    np.testing.assert_allclose(dataset.states[39:88, :2], truth.position[40:89], atol=1e-6)
    assert dataset.columns["nas.time"][39] == 0


def test_episodes_that_are_too_short_are_left_out_and_named(tmp_path):
    truth, mapping = motion(), sample_map(tmp_path, ".npz", '[read.episode]\ncolumn = "take"')
    log = write_log(tmp_path / "log.npz", columns_of(truth) | {"take": np.repeat([1, 2, 3], [58, 2, 60])})
    result = import_logs([log], mapping)
    assert result.dataset.lengths.tolist() == [57, 59] and result.dataset.tasks == ("log:1", "log:3")
    (finding,) = result.findings
    assert finding.check == "too_short" and finding.file.endswith("log.npz:2") and finding.rows == (58, 59)
    assert "has only 2 rows; at least 3 are needed, so it is left out" in finding.message


def test_a_stray_row_before_a_gap_is_left_out_and_named(tmp_path):
    truth = motion()
    log = write_log(tmp_path / "log.npz", columns_of(truth.edited(time=truth.time + 5.0 * (np.arange(120) > 0))))
    result = import_logs([log], sample_map(tmp_path))
    assert result.dataset.lengths.tolist() == [118]
    assert [finding.rows for finding in result.findings if finding.check == "too_short"] == [(0,)]


def test_one_of_several_logs_may_be_too_short(tmp_path):
    for name, rows in (("a", 2), ("b", 120)):
        write_log(tmp_path / f"{name}.npz", {key: values[:rows] for key, values in columns_of(motion()).items()})
    result = import_logs([tmp_path], sample_map(tmp_path))
    assert result.dataset.tasks == ("b",) and [finding.check for finding in result.findings] == ["too_short"]


def test_episodes_that_come_back_are_refused(tmp_path):
    mapping = sample_map(tmp_path, ".npz", '[read.episode]\ncolumn = "take"')
    log = write_log(tmp_path / "log.npz", columns_of(motion()) | {"take": np.repeat([1, 2, 1], 40)})
    with pytest.raises(LogError, match="the episode '1' appears again after another one"):
        import_logs([log], mapping)
    log = write_log(tmp_path / "log.npz", columns_of(motion()) | {"take": np.zeros((120, 2))})
    with pytest.raises(MapError, match="one value a row"):
        import_logs([log], mapping)


def recording(time: np.ndarray) -> Recording:
    """Positions linear in time, commands that count rows."""
    line = np.column_stack([2 * time, -time])
    count = np.arange(len(time), dtype=float)[:, None] * np.ones((1, 2))
    return Recording(
        "log", "", ("a", "b"), time, line, np.ones_like(line), count, {"on": count[:, :1]}, np.arange(len(time))
    )


@settings(max_examples=50)
@given(
    steps=st.lists(st.sampled_from([0.0, 0.001, 0.004, 0.01, 0.03]), min_size=3, max_size=60),
    rate=st.sampled_from([20.0, 50.0, 188.0, 200.0]),
)
def test_resampling_keeps_lines_straight_and_holds_commands(steps, rate):
    time = np.concatenate([[0.0], np.cumsum(steps)])
    even = resample(recording(time), Resample(rate, "linear"))
    np.testing.assert_allclose(even.time, np.arange(len(even.time)) / rate)
    assert time[-1] - 1 / rate - 1e-5 < even.time[-1] <= time[-1] + 1e-5
    np.testing.assert_allclose(even.positions, np.column_stack([2 * even.time, -even.time]), atol=1e-4)
    acting = np.searchsorted(time, even.time + 0.5 / rate - 1e-9, side="right") - 1
    np.testing.assert_array_equal(even.commands[:, 0], acting)
    np.testing.assert_array_equal(even.signals["on"][:, 0], acting)
    np.testing.assert_array_equal(even.rows, acting)
    last = np.searchsorted(time, even.time + 1e-9, side="right") - 1
    held = resample(recording(time), Resample(rate, "previous"))
    np.testing.assert_array_equal(held.positions, recording(time).positions[last])


@settings(max_examples=50)
@given(late=st.lists(st.floats(-0.2, 0.2), min_size=5, max_size=60), rate=st.sampled_from([20.0, 50.0, 188.0]))
def test_resampling_gives_each_row_its_own_command_though_the_clock_jitters(late, rate):
    time = (np.arange(len(late)) + late - late[0]) / rate
    even = resample(recording(time), Resample(rate, "linear"))
    np.testing.assert_array_equal(even.commands[:, 0], np.arange(len(even.time)))


@pytest.mark.parametrize("rate", [40.0, 50.0, 188.0, 1000.0])
def test_resampling_to_another_rate_makes_commands_neither_early_nor_late(rate):
    logged = 200.0
    time = np.arange(400) / logged
    even = resample(recording(time), Resample(rate, "linear"))
    acted = even.commands[:, 0] / logged + 0.5 / logged  # the middle of the command's own step
    late = even.time + 0.5 / rate - acted
    assert abs(late[:-1].mean()) < 0.51 / logged


def test_resampling_to_the_recorded_times_changes_nothing(tmp_path):
    truth = motion()
    log = write_log(tmp_path / "log.npz", columns_of(truth))
    plain = import_logs([log], sample_map(tmp_path)).dataset
    even = import_logs([log], sample_map(tmp_path, ".npz", f'[resample]\nrate = {RATE}\nmethod = "linear"'))
    assert even.dataset.lengths.tolist() == plain.lengths.tolist()
    for key in plain.columns:
        np.testing.assert_allclose(even.dataset.columns[key], plain.columns[key], atol=1e-6)
    assert "resampled" in even.provenance.derived["observation.state"]


def test_resampling_a_log_of_a_moment_is_refused(tmp_path):
    log = write_log(tmp_path / "log.npz", {key: values[:4] for key, values in columns_of(motion()).items()})
    with pytest.raises(LogError, match=r"log.npz: the episode of .* has only 1 row after resampling; at least 2"):
        import_logs([log], sample_map(tmp_path, ".npz", '[resample]\nrate = 10\nmethod = "linear"'))


def test_derived_velocities_are_near_the_truth_and_said_to_be_derived(tmp_path):
    truth = motion()
    log = write_log(tmp_path / "log.npz", columns_of(truth))
    result = import_logs([log], sample_map(tmp_path, velocity='"derive"'))
    np.testing.assert_allclose(result.dataset.states[5:-5, 2:], truth.velocity[5:-6], rtol=0.02, atol=0.02)
    assert "velocities" in result.provenance.derived["observation.state"]
    # The register that was not used is kept under its own name.
    np.testing.assert_allclose(result.dataset.columns["nas.velocity"], truth.velocity[:-1], atol=1e-6)
    assert "nas.velocity" not in import_logs([log], sample_map(tmp_path)).dataset.columns


def test_each_next_state_is_the_following_state(tmp_path):
    log = write_log(tmp_path / "log.npz", columns_of(motion()))
    result = import_logs([log], sample_map(tmp_path))
    np.testing.assert_array_equal(result.dataset.next_states[:-1], result.dataset.states[1:])
    assert result.provenance.contiguous


@given(rows=st.sets(st.integers(0, 60), min_size=1))
def test_spans_say_the_same_rows(rows):
    ordered = sorted(rows)
    assert [row for first, last in find_row_spans(ordered) for row in range(first, last + 1)] == ordered
    text = format_rows(ordered)
    assert text.startswith("row " if len(ordered) == 1 else "rows ")
    assert str(ordered[0]) in text


def test_errors_refuse_the_import_and_name_log_rows_and_remedy(tmp_path):
    truth = motion()
    position = truth.position.copy()
    position[17, 1] = np.nan
    broken = truth.edited(position=position)
    good = write_log(tmp_path / "good.npz", columns_of(truth))
    bad = write_log(tmp_path / "bad.npz", columns_of(broken))
    worse = write_log(tmp_path / "worse.npz", columns_of(broken))
    mapping = load_map(write_map(tmp_path))
    with pytest.raises(
        LogError,
        match=r"bad.npz: the position is empty, NaN or infinite in row 17 \(counted from 0\); remove these rows",
    ):
        import_logs([good, bad], mapping)
    with pytest.raises(LogError, match=r"And 1 more like this \(in .*worse.npz\)"):
        import_logs([good, bad, worse], mapping)


LINES = {
    "plain": ("t,q\n{}\n{}\n{}\n", 4),
    "empty lines": ("\n\nt,q\n\n{}\n{}\n\n{}\n", 8),
    "Windows": ("t,q\r\n\r\n{}\r\n{}\r\n{}\r\n", 5),
    "byte order mark": ("\ufefft,q\n{}\n{}\n{}", 4),
}


@pytest.mark.parametrize("kind", LINES)
def test_a_row_of_a_text_log_is_named_by_its_line_in_an_editor(tmp_path, kind):
    text, line = LINES[kind]
    log = tmp_path / "log.csv"
    log.write_text(text.format("0,0", "1,1", "2,here"), encoding="utf-8", newline="")
    table = read_table(log, LogLayout("csv"))
    assert "here" in log.read_text(encoding="utf-8").splitlines()[line - 1]
    assert table.name_rows([2]) == f"row 2 (line {line} of log.csv)"
    with pytest.raises(LogError, match=rf"holds 'here' in row 2 \(line {line} of log.csv\)"):
        table.numbers("q")


def test_no_line_is_named_where_a_row_takes_several(tmp_path):
    log = tmp_path / "log.csv"
    log.write_text('t,q\n0,"one\ntwo"\n1,here\n')
    assert read_table(log, LogLayout("csv")).name_rows([1]) == "row 1 (counted from 0)"


def test_rows_in_several_places_are_named_with_their_lines(tmp_path):
    lines = TextLines(two_files(tmp_path) / "state.csv", 120)
    assert format_rows([3, 4, 5, 9], lines) == "rows 3–5, 9 (lines 5–7, 11 of state.csv)"
    assert format_rows(range(0, 12, 2), lines) == (
        "rows 0, 2, 4, 6, 8 and 1 more place (lines 2, 4, 6, 8, 10 … of state.csv)"
    )
    assert format_rows(range(0, 14, 2)) == "rows 0, 2, 4, 6, 8 and 2 more places (counted from 0)"


def test_rows_keep_their_number_where_those_of_another_publisher_are_left_out(tmp_path):
    columns = {key: values.tolist() for key, values in columns_of(motion()).items()}
    columns["q"][17][1] = float("nan")
    columns["names"] = [["shoulder", "elbow"]] * 120
    for key, values in columns.items():
        values.insert(5, ["wheel", "rudder"] if key == "names" else values[4])
    pa.parquet.write_table(pa.table(columns), tmp_path / "log.parquet")
    with pytest.raises(LogError, match=r"the position is empty, NaN or infinite in row 18 \(counted from 0\)"):
        import_logs([tmp_path / "log.parquet"], sample_map(tmp_path, ".parquet", top='joint_names = "names"'))
