"""`nas import`: what it writes and prints; bad input gets one sentence and leaves nothing behind."""

import json
from pathlib import Path

import numpy as np
import pytest
from support.import_samples import columns_of, map_text, motion, write_log, write_map

from nas_data.cli import main
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import ACTION, NEXT_STATE, STATE, make_position_feature
from nas_data.dataset.layout import PROVENANCE
from nas_data.dataset.provenance import Provenance, read_provenance
from nas_data.dataset.read import read
from nas_data.dataset.verify import verify
from nas_data.dataset.write import write


@pytest.fixture
def here(tmp_path, monkeypatch) -> Path:
    """An empty working folder with a log and its map beside it."""
    monkeypatch.chdir(tmp_path)
    write_log(tmp_path / "log.npz", columns_of(motion()))
    write_map(tmp_path, map_text(extra="[audit]\nmax_speed = 3.9"))
    return tmp_path


def test_it_writes_a_sound_dataset_and_says_where(here, capsys):
    assert main(["import", "log.npz", "--map", "map.toml", "--name", "mine"]) == 0
    out = capsys.readouterr().out
    assert "sample: 1 episode, 119 transitions at 50 Hz" in out
    assert "Warning jump:\n  log.npz: elbow reaches" in out
    (root,) = (here / "datasets/mine").glob("v1-*")
    assert f"The dataset is in datasets/mine/{root.name}" in out
    assert verify(root) == []
    dataset = read(root)
    assert dataset.joints == ("shoulder", "elbow") and dataset.tasks == ("log",)
    np.testing.assert_allclose(dataset.commands, motion().command[:-1], atol=1e-6)
    provenance = read_provenance(root)
    assert provenance is not None and provenance.how == "imported" and "jump: log.npz: elbow" in provenance.notes
    assert (root / "meta/import_map.toml").read_text() == (here / "map.toml").read_text()


def test_the_name_is_the_robots_where_none_is_given(here):
    assert main(["import", "log.npz", "--map", "map.toml"]) == 0
    assert list((here / "datasets").iterdir()) == [here / "datasets/sample"]


def test_json_lists_the_audit_by_row(here, capsys):
    assert main(["import", "log.npz", "--map", "map.toml", "--out", "result", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["dataset"] == "result" and answer["frames"] == 119
    (finding,) = answer["audit"]
    assert finding["check"] == "jump" and finding["file"] == "log.npz"
    assert finding["count"] == len(finding["rows"]) > 0 and "rad/s" in finding["message"]


def test_a_dataset_of_lerobots_needs_no_map(here, capsys):
    joints = ("shoulder", "elbow")
    moved = np.cumsum(np.full((40, 2), 0.01), axis=0).astype(np.float32)
    features = {key: make_position_feature(joints) for key in (STATE, ACTION)}
    columns = {STATE: moved, ACTION: moved + np.float32(0.02)}
    lerobots = Dataset(features=features, columns=columns, lengths=np.array([20, 20]), fps=50.0, tasks=("wave",) * 2)
    write(lerobots, here / "wave", Provenance(how="simulated"))
    (here / "wave" / PROVENANCE).unlink()  # what LeRobot writes has none
    assert main(["import", "wave", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    dataset, provenance = read(Path(answer["dataset"])), read_provenance(Path(answer["dataset"]))
    assert verify(Path(answer["dataset"])) == []
    assert dataset.lengths.tolist() == [19, 19]
    np.testing.assert_allclose(dataset.states[:, 2:], 0.5, atol=1e-3)
    assert set(provenance.derived) == {STATE, NEXT_STATE}
    assert provenance.parents[0].name == "wave"
    assert main(["import", answer["dataset"]]) == 2
    assert "is a dataset of nas already" in capsys.readouterr().err
    assert main(["import", "datasets/wave"]) == 2
    assert "is a dataset of nas already" in capsys.readouterr().err
    assert main(["import", "wave", "wave"]) == 2
    assert "one at a time" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--map", "map.toml"], "No log is given"),
        (["log.npz"], "log.npz is not a LeRobot dataset; to import a log, give --map"),
        (["none.npz"], "There is no log none.npz"),
        (["none.npz", "--map", "map.toml"], "There is no log none.npz"),
        (["log.npz", "--map", "none.toml"], "There is no map none.toml"),
        (["log.npz", "--map", "other"], "There is no map 'other'"),
        (["log.npz", "--map", "so101_npz"], "log.npz has no column 'joint_names'"),
        (["log.npz", "--map", "so101_csv"], "log.npz is not a folder"),
        (["map.toml", "--map", "map.toml"], "map.toml does not end in .npz"),
        (["nan.npz", "--map", "map.toml"], "nan.npz: the velocity is empty, NaN or infinite in row 3"),
        (["log.npz", "--map", "map.toml", "--name", "a/b"], "'a/b' is not a valid dataset name"),
        (["log.npz", "--map", "map.toml", "--out", "taken"], "taken exists already"),
        (["log.npz", "--map", "map.toml", "--cut", "nan"], "The length of a segment is nan s; give a number"),
        (["log.npz", "--map", "map.toml", "--cut", "inf"], "The length of a segment is inf s; give a number"),
    ],
)
def test_bad_input_gets_one_sentence_and_leaves_nothing(here, capsys, arguments, sentence):
    columns = columns_of(motion())
    columns["dq"][3] = np.nan
    write_log(here / "nan.npz", columns)
    (here / "taken").mkdir()
    before = sorted(here.rglob("*"))
    assert main(["import", *arguments]) == 2
    captured = capsys.readouterr()
    assert sentence in captured.err and captured.err.count("\n") == 1 and captured.out == ""
    assert sorted(here.rglob("*")) == before


@pytest.mark.parametrize("by_map", [True, False])
def test_a_name_that_no_dataset_can_have_is_refused_before_logs_are_read(here, capsys, monkeypatch, by_map):
    write_map(here, map_text(extra="[audit]\nmax_speed = 3.9").replace('"sample"', '"my arm"'))
    features = {key: make_position_feature(("a", "b")) for key in (STATE, ACTION)}
    columns = {key: motion().position for key in features}
    plain = Dataset(features, columns, np.array([120]), 50.0, "my arm", ("wave",))
    write(plain, here / "wave", Provenance(how="simulated"))
    (here / "wave" / PROVENANCE).unlink()
    arguments = ["log.npz", "--map", "map.toml"] if by_map else ["wave", "--unit", "rad"]
    with monkeypatch.context() as unread:
        unread.setattr("nas_data.api.importing.read_logs", lambda request: pytest.fail("logs are read"))
        assert main(["import", *arguments]) == 2
    assert "'my arm' is not a valid dataset name" in (said := capsys.readouterr().err) and "--name" in said
    assert main(["import", *arguments, "--name", "mine"]) == 0


def test_help_has_an_example(capsys):
    with pytest.raises(SystemExit) as stopped:
        main(["import", "--help"])
    assert stopped.value.code == 0
    assert "nas import recordings/*.npz --map so101_npz" in " ".join(capsys.readouterr().out.split())
