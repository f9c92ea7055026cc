"""MCAP files and bags of ROS: topics of different rates, names in any order in every message, joined by time."""

import numpy as np
import pytest
from support.bag_samples import MAP, START, angle, commands, write_json_mcap, write_mcap, write_rosbag
from support.import_samples import write_map

from nas_data.cli import main
from nas_data.dataset.read import read
from nas_data.errors import LogError, MapError
from nas_data.importing.map_file import load_map
from nas_data.recorders.logs import import_logs

BAGS = {"mcap": ("mcap", write_mcap), "json": ("mcap", write_json_mcap), "rosbag": ("rosbag", write_rosbag)}


@pytest.mark.parametrize("kind", BAGS)
def test_a_bag_is_joined_by_time_and_by_the_names_in_its_messages(tmp_path, kind):
    format_name, write = BAGS[kind]
    log = write(tmp_path / ("bag" if format_name == "rosbag" else "bag.mcap"))
    result = import_logs([log], load_map(write_map(tmp_path, MAP.format(format=format_name))))
    dataset = result.dataset
    assert result.findings == () and dataset.joints == ("shoulder", "elbow") and dataset.n_frames == 199
    time = dataset.columns["nas.time"][:, 0]
    np.testing.assert_allclose(time, np.arange(199) / 50, atol=1e-6)
    np.testing.assert_allclose(dataset.states[:, :2], angle(time), atol=1e-6)
    received = np.array([(stamp - START) / 1e9 for stamp, _ in commands()])
    goals = np.array([goal for _, goal in commands()])
    last = np.searchsorted(received, time + 1e-9, side="right") - 1
    np.testing.assert_allclose(dataset.commands, goals[last], atol=1e-6)


def test_a_bag_is_imported_by_the_command(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_rosbag(tmp_path / "bag")
    write_map(tmp_path, MAP.format(format="rosbag"))
    assert main(["import", "bag", "--map", "map.toml", "--out", "done"]) == 0
    assert read(tmp_path / "done").n_frames == 199


@pytest.mark.parametrize("kind", BAGS)
def test_a_topic_that_is_not_there_is_answered_with_those_that_are(tmp_path, kind):
    format_name, write = BAGS[kind]
    log = write(tmp_path / ("bag" if format_name == "rosbag" else "bag.mcap"))
    text = MAP.format(format=format_name).replace('"/commands"', '"/goals"')
    with pytest.raises(LogError, match=r"no topic '/goals'.*it has: /commands, /joint_states"):
        import_logs([log], load_map(write_map(tmp_path, text)))


@pytest.mark.parametrize("format_name", ["mcap", "rosbag"])
def test_what_is_no_bag_is_refused_in_a_sentence(tmp_path, format_name):
    mapping = load_map(write_map(tmp_path, MAP.format(format=format_name)))
    whole = write_mcap(tmp_path / "bag.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "bad.bag").write_bytes(b"no bag at all")
    (tmp_path / "empty").mkdir()
    for log in ("cut.mcap", "bad.bag", "empty", "none.mcap"):
        with pytest.raises((LogError, MapError)) as raised:
            import_logs([tmp_path / log], mapping)
        assert str(raised.value).endswith(".") and "\n" not in str(raised.value)


def test_joints_that_no_message_names_are_refused(tmp_path):
    log = write_mcap(tmp_path / "bag.mcap")
    text = MAP.format(format="mcap").replace('["shoulder", "elbow"]', '["shoulder", "knee"]')
    with pytest.raises(LogError, match="lacks the joint 'knee'"):
        import_logs([log], load_map(write_map(tmp_path, text)))
    text = MAP.format(format="mcap").replace('["shoulder", "elbow"]', '["hip", "knee"]')
    with pytest.raises(MapError, match=r"no row names a joint of the map \(hip, knee\)"):
        import_logs([log], load_map(write_map(tmp_path, text)))
