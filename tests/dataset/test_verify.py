"""`nas verify` rejects every damage it promises to find, and `nas info` shows what is there."""

import json
import re
import shutil
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from support.changed_columns import set_values
from support.dataset_samples import recorded

from nas_data.cli import main
from nas_data.dataset import layout
from nas_data.dataset.features import ACTION, SIM_STATE, STATE, TIME, Feature
from nas_data.dataset.provenance import Parent, Provenance
from nas_data.dataset.timing import find_late_readings
from nas_data.dataset.verify import examine, verify
from nas_data.dataset.versions import make_parent, save, write_version
from nas_data.dataset.write import write

RECORDED = Provenance(how="simulated", robot="ergojr", contiguous=True)


@pytest.fixture
def root(tmp_path):
    return write_version(recorded(lengths=(20, 30)), "arm", RECORDED, tmp_path)


def change_column(file, key, change):
    """Rewrite a Parquet file with one column changed."""
    table = pq.read_table(file)
    place = table.column_names.index(key)
    pq.write_table(table.set_column(place, table.schema.field(place), change(table[key])), file)


def data_file(root):
    return layout.list_data_files(root)[0]


def _flip_bit(root):
    content = bytearray(data_file(root).read_bytes())
    content[200] ^= 1
    data_file(root).write_bytes(content)


def _shift(key):
    def shift(root):
        change_column(data_file(root), key, lambda column: pa.compute.add(column, pa.scalar(1, column.type)))

    return shift


def _change_action(root):
    values = np.zeros(50 * 3, np.float32)
    change_column(data_file(root), ACTION, lambda _: pa.FixedSizeListArray.from_arrays(pa.array(values), 3))


def _episode_length(root):
    change_column(layout.list_episode_files(root)[0], "length", lambda column: pa.compute.add(column, 1))


def _stats(root):
    path = root / layout.STATS
    stats = json.loads(path.read_text())
    stats[STATE]["max"][0] += 1
    path.write_text(json.dumps(stats))


def _rename(root):
    root.rename(root.parent / "v1-00000000")


DAMAGES = {
    "nas.json is missing.*merge": lambda root: (root / layout.PROVENANCE).unlink(),
    r"file-000\.parquet was changed": _flip_bit,
    "tasks.parquet is missing": lambda root: (root / layout.TASKS).unlink(),
    "The content hash is": _change_action,
    "frame_index is 1 where 0 is expected": _shift("frame_index"),
    "^index is 1 where 0 is expected": _shift("index"),
    "timestamp is not frame_index": _shift("timestamp"),
    "meta/episodes says length 21 for episode 0, the rows say 20": _episode_length,
    "no complete episode table": lambda root: shutil.rmtree(root / "meta/episodes"),
    "The max of 'observation.state' in .* does not match": _stats,
    r"file-001\.parquet was added": lambda root: shutil.copy(
        layout.list_episode_files(root)[0], layout.list_episode_files(root)[0].with_name("file-001.parquet")
    ),
    "half-written": lambda root: data_file(root).write_bytes(b"PAR1 killed"),
    "is named v1-00000000": _rename,
    "a killed process left": lambda root: (root.parent / ".version.partial-0badcafe").mkdir(),
}


def test_a_fresh_version_is_sound(root):
    assert verify(root) == []
    assert examine(root).notes == ()


@pytest.mark.parametrize("message", DAMAGES)
def test_damage_is_found(root, message, capsys):
    DAMAGES[message](root)
    home = root if root.exists() else root.parent / "v1-00000000"
    problems = verify(home)
    assert [problem for problem in problems if re.search(message, problem)], problems
    assert main(["verify", str(home)]) == 1
    assert "problem" in capsys.readouterr().out


def _written(tmp_path, dataset, provenance=RECORDED):
    return examine(write(dataset, tmp_path / "d", provenance))


def _clock(dataset, times):
    return dataset.with_column(TIME, dataset.features[TIME], np.asarray(times)[:, None])


def test_a_clock_that_stands_still_is_a_problem(tmp_path):
    times = np.arange(20) / 50
    times[7] = times[6]
    found = _written(tmp_path, _clock(recorded(lengths=(20,)), times))
    assert "In episode 0 the time does not increase in row 7" in found.problems[0]


def test_a_rate_that_the_clock_denies_is_a_problem(tmp_path):
    found = _written(tmp_path, _clock(recorded(lengths=(20,), fps=100.0), np.arange(20) / 85))
    assert "come at 85 Hz" in found.problems[0]


def test_time_stamps_are_compared_with_their_own_statistics(tmp_path):
    root = write(recorded(lengths=(20,)).without_columns({TIME}), tmp_path / "d", RECORDED)
    stats = json.loads((root / layout.STATS).read_text())
    for last, said in ((19 / 50, ["The max of 'timestamp' in"]), (19 / 50 + 1, [])):
        (root / layout.STATS).write_text(json.dumps(stats | {"timestamp": {"min": [0.0], "max": [last]}}))
        change_column(data_file(root), "timestamp", lambda _: pa.array(np.arange(20) / 50 + (np.arange(20) > 9), "f4"))
        found = [problem for problem in verify(root) if "does not match the data" in problem]
        assert len(found) == len(said) and all(map(str.startswith, found, said)), found


def test_an_hour_whose_float32_stamps_are_as_near_as_they_can_be_is_sound(tmp_path):
    root = write(recorded(lengths=(180_000,), joints=("m1",)), tmp_path / "d", RECORDED)
    assert verify(root) == []
    change_column(data_file(root), "timestamp", lambda column: pa.compute.add(column, pa.scalar(1e-3, pa.float32())))
    assert any("timestamp is not frame_index / fps" in problem for problem in verify(root))


def test_late_rows_are_counted_in_a_note(tmp_path):
    times = np.arange(200) / 50
    times[90:] += 0.013
    found = _written(tmp_path, _clock(recorded(lengths=(200,)), times))
    assert found.problems == ()
    assert "In episode 0 the step before row 90 (counted from 0) is 33 ms instead of 20 ms" in found.notes[0]


@pytest.mark.parametrize(("delay", "late"), [(0.25, 0), (0.35, 1)])
def test_who_records_and_who_checks_take_the_same_rows_for_late(tmp_path, delay, late):
    due = np.arange(20) / 50
    times = due + np.where(np.arange(20) == 9, delay / 50, 0)
    notes = _written(tmp_path, _clock(recorded(lengths=(20,)), times)).notes
    assert any("the step before row" in note for note in notes) == bool(late)
    assert find_late_readings(times - due, 1 / 50).sum() == late


@pytest.mark.parametrize("contiguous", [True, False])
def test_torn_transitions_are_a_problem_only_where_a_chain_was_promised(tmp_path, contiguous):
    whole = recorded(lengths=(20, 30))
    dataset = set_values(whole, "next.observation.state", (3, 0), whole.next_states[3, 0] + 0.5)
    found = _written(tmp_path, dataset, replace(RECORDED, contiguous=contiguous))
    assert any("In 1 frame " in text for text in (found.problems if contiguous else found.notes))
    assert bool(found.problems) == contiguous


def test_verify_tells_no_dataset_from_a_bad_one(tmp_path, root, capsys):
    assert main(["verify", str(root.parent)]) == 0
    assert main(["verify", str(tmp_path / "none")]) == 2
    assert main(["verify", str(tmp_path), "--json"]) == 2
    assert "Traceback" not in capsys.readouterr().err


def test_verify_prints_json(root, capsys):
    (root / layout.PROVENANCE).unlink()
    assert main(["verify", str(root), "--json"]) == 1
    answer = json.loads(capsys.readouterr().out)
    assert answer["sound"] is False
    assert "nas.json" in answer["problems"][0]


def paired_child(root):
    dataset = recorded(lengths=(20, 30))
    paired = dataset.with_column(SIM_STATE, dataset.features[STATE], dataset.next_states)
    source = {"name": "ergojr.xml", "engine": "mujoco"}
    provenance = Provenance(how="paired", source=source, parents=(make_parent(root, dataset),))
    return save(paired, provenance, parent=root)


def test_info_shows_pairing_ranges_and_ancestry(root, capsys):
    child = paired_child(root)
    assert main(["info", str(root.parent)]) == 0
    text = capsys.readouterr().out
    assert f"arm/{child.name}: paired" in text and f"arm/{root.name}: simulated" in text
    assert "m1, m2, m3" in text and "ergojr.xml, mujoco" in text
    assert "action m2.pos" in text and "50 Hz" in text


def test_info_prints_json(root, capsys):
    assert main(["info", str(paired_child(root)), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    dataset = recorded(lengths=(20, 30))
    assert (answer["episodes"], answer["frames"], answer["duration"]) == (2, 50, 1.0)
    assert answer["paired"] is True and answer["derived"] == {} and answer["commands"] == "position"
    assert answer["ranges"][ACTION]["m3.pos"] == [dataset.commands[:, 2].min(), dataset.commands[:, 2].max()]
    assert [entry["how"] for entry in answer["provenance"]] == ["paired", "simulated"]


def test_info_stops_where_a_parent_of_that_name_has_other_content(root, tmp_path, capsys):
    provenance = Provenance(how="edited", parents=(Parent(f"arm/{root.name}", "0" * 64),))
    child = save(recorded(seed=5), provenance, parent=root)
    assert main(["info", str(child), "--json"]) == 0
    assert len(json.loads(capsys.readouterr().out)["provenance"]) == 1


def test_info_of_a_file_says_that_it_is_one(tmp_path, capsys):
    (tmp_path / "arm.toml").touch()
    assert main(["info", str(tmp_path / "arm.toml")]) == 2
    assert "arm.toml is a file, not a dataset; give a dataset's folder" in capsys.readouterr().err


def test_info_says_what_would_be_derived_or_why_nothing_can_be(tmp_path, capsys):
    plain = recorded(lengths=(20, 30))
    features = {STATE: Feature(("a", "b")), ACTION: Feature(("a", "b"))}
    columns = dict.fromkeys(features, plain.commands[:, :2])
    dataset = replace(plain, features=features, columns=columns)
    write(dataset, tmp_path / "radians", RECORDED)
    assert main(["info", str(tmp_path / "radians")]) == 0
    assert "derived when used: observation.state: velocities" in capsys.readouterr().out
    degrees = replace(dataset, columns={key: column * 57.3 for key, column in columns.items()})
    write(degrees, tmp_path / "degrees", RECORDED)
    assert main(["info", str(tmp_path / "degrees")]) == 0
    assert "cannot be radians" in capsys.readouterr().out


@pytest.mark.parametrize("command", ["info", "verify"])
def test_each_command_explains_itself_with_an_example(command, capsys):
    with pytest.raises(SystemExit) as stopped:
        main([command, "--help"])
    assert stopped.value.code == 0
    assert f"nas {command} datasets/" in capsys.readouterr().out
