"""MCAP files and bags of ROS: topics of different rates, names in any order in every message, joined by time."""

import json

import numpy as np
import pytest
from mcap.writer import Writer
from support.bag_samples import (
    MAP,
    NAMES,
    START,
    angle,
    commands,
    header,
    states,
    write_json_mcap,
    write_mcap,
    write_rosbag,
)
from support.import_samples import write_map

from nas_data.cli import main
from nas_data.dataset.read import read
from nas_data.errors import LogError, MapError
from nas_data.importing.formats import read_tables
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
    last = np.searchsorted(received, time + 0.01 + 1e-9, side="right") - 1  # half a step after the state
    np.testing.assert_allclose(dataset.commands, goals[last], atol=1e-6)


def test_a_bag_is_imported_by_the_command(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_rosbag(tmp_path / "bag")
    write_map(tmp_path, MAP.format(format="rosbag"))
    assert main(["import", "bag", "--map", "map.toml", "--out", "done"]) == 0
    assert read(tmp_path / "done").n_frames == 199


def write_servo(path, gain, late, rows=150):
    """A first-order servo at 50 Hz: state i+1 = state i + gain · (command i − state i). Commands come after states."""
    command = np.repeat(np.random.default_rng(1).uniform(-0.5, 0.5, (rows // 10, 2)), 10, axis=0)
    state = np.zeros((rows, 2))
    for row in range(rows - 1):
        state[row + 1] = state[row] + gain * (command[row] - state[row])
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("any", "jsonschema", b"{}")
        for topic, field, values, delay in (
            ("joint_states", "position", state, 0.0),
            ("commands", "data", command, late),
        ):
            channel = writer.register_channel(f"/{topic}", "json", schema)
            for row in range(rows):
                time = START + round((row / 50 + delay) * 1e9)
                content = json.dumps({field: values[row].tolist()}).encode()
                writer.add_message(channel, log_time=time, data=content, publish_time=time)
        writer.finish()
    return path


@pytest.mark.parametrize("late", [-0.005, 0.0, 0.002, 0.008])
def test_a_command_that_follows_its_state_by_milliseconds_is_not_a_step_late(tmp_path, late):
    write_servo(tmp_path / "bag.mcap", 0.39, late)
    dataset = import_bag(tmp_path, lambda text: unnamed(text).replace('column = "header.stamp"', 'column = "log_time"'))
    moved = dataset.next_states[:, :2] - dataset.states[:, :2]
    np.testing.assert_allclose(moved, 0.39 * (dataset.commands - dataset.states[:, :2]), atol=1e-6)


def test_a_command_that_is_answered_by_its_state_is_the_last_before_it(tmp_path):
    write_servo(tmp_path / "bag.mcap", 0.39, 0.002)

    def answer(text):
        text = unnamed(text).replace('column = "header.stamp"', 'column = "log_time"')
        return text.replace("action_follows_state", "state_follows_action")

    dataset = import_bag(tmp_path, answer)
    moved = dataset.next_states[:, :2] - dataset.states[:, :2]
    np.testing.assert_allclose(moved, 0.39 * (dataset.commands - dataset.states[:, :2]), atol=1e-6)


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


def write_messages(
    path, change_state=dict, change_command=dict, encoding="json", commanded="/commands", unheard=(), **options
):
    """Write the sample's messages as JSON, each changed by a function; `options` are those of MCAP's writer.

    Unheard topics have a channel but no message.
    """
    messages = [("/joint_states", time, change_state({"header": header(time), **state})) for time, state in states()]
    messages += [(commanded, time, change_command({"data": goal})) for time, goal in commands()]
    with path.open("wb") as file:
        writer = Writer(file, **options)
        writer.start()
        schema = writer.register_schema("any", "jsonschema", b"{}")
        topics = dict.fromkeys([*(topic for topic, _, _ in messages), *unheard])
        channels = {topic: writer.register_channel(topic, encoding, schema) for topic in topics}
        for topic, time, content in messages:
            writer.add_message(channels[topic], log_time=time, data=json.dumps(content).encode(), publish_time=time)
        writer.finish()
    return path


def import_bag(folder, change=str):
    return import_logs([folder / "bag.mcap"], load_map(write_map(folder, change(MAP.format(format="mcap"))))).dataset


def test_commands_are_put_in_order_by_the_names_of_their_own_type_of_message(tmp_path):
    right = import_bag(write_json_mcap(tmp_path / "bag.mcap").parent).commands

    def as_trajectory(message):
        return {"joint_names": ["elbow", "shoulder"], "points": [{"positions": message["data"][::-1]}]}

    write_messages(tmp_path / "bag.mcap", change_command=as_trajectory)
    found = import_bag(tmp_path, lambda text: text.replace('column = "data"', 'column = "points.0.positions"'))
    np.testing.assert_array_equal(found.commands, right)


def turned(message):
    """A message with the joints of the map only, in the other order."""
    kept = [message["name"].index(name) for name in ("elbow", "shoulder") if name in message["name"]]
    return {**message, **{key: [message[key][k] for k in kept] for key in ("name", "position")}}


def renamed(message):
    """The same message by a driver that calls each joint by a name of its own."""
    message = turned(message)
    return {**message, "name": [f"{name}_joint" for name in message["name"]]}


def unnamed(text):
    return text.replace('joint_names = "name"\n', "")


def test_the_names_in_messages_count_though_the_map_does_not_name_their_field(tmp_path):
    right = import_bag(write_json_mcap(tmp_path / "bag.mcap").parent)
    write_messages(tmp_path / "bag.mcap", change_state=turned)
    np.testing.assert_array_equal(import_bag(tmp_path, unnamed).states, right.states)


def test_names_of_the_driver_are_given_in_the_order_of_the_joints(tmp_path):
    right = import_bag(write_json_mcap(tmp_path / "bag.mcap").parent)
    write_messages(tmp_path / "bag.mcap", change_state=renamed)

    def give_names(text):
        given = 'column = "position"\nnames = ["shoulder_joint", "elbow_joint"]'
        return unnamed(text).replace('column = "position"', given)

    np.testing.assert_array_equal(import_bag(tmp_path, give_names).states, right.states)
    both = (
        r"no row names a joint of the map \(shoulder, elbow\); the first names elbow_joint, shoulder_joint\..* names = "
    )
    with pytest.raises(MapError, match=both):
        import_bag(tmp_path, unnamed)


def test_a_signal_with_names_of_its_own_leaves_the_joints_theirs(tmp_path):
    right = import_bag(write_json_mcap(tmp_path / "bag.mcap").parent)

    def add_fingers(message):
        if "gripper" in message["name"]:
            return message
        joints = [*message["name"], "f1", "f2"]
        return {**message, "name": joints, "position": [*message["position"], 7, 8], "effort": [0, 0, 0, 1, 2]}

    write_messages(tmp_path / "bag.mcap", change_state=add_fingers)
    fingers = '\n[signals.fingers]\ntopic = "state"\ncolumn = "effort"\nnames = ["f2", "f1"]\nunit = "rad"\n'
    found = import_bag(tmp_path, lambda text: unnamed(text) + fingers)
    np.testing.assert_array_equal(found.states, right.states)
    assert (found.columns["nas.fingers"] == [2, 1]).all()


def test_names_are_refused_where_the_messages_have_none(tmp_path):
    write_json_mcap(tmp_path / "bag.mcap")
    with pytest.raises(MapError, match=r"/commands has no names of components, .*\[a, b\]; .* components = \[…\]"):
        import_bag(tmp_path, lambda text: text.replace('column = "data"', 'column = "data"\nnames = ["a", "b"]'))


def test_each_topic_of_one_joint_may_call_it_by_another_name(tmp_path):
    def make_state(joint, value):
        return {"name": ["other", f"{joint}_joint"], "position": [9.0, value]}

    log = write_topics_of_joints(tmp_path / "bag.mcap", make_state)
    text = EACH.format(format="mcap", position="position")
    text = text.replace('column = "position"', 'column = "position"\nnames = ["shoulder_joint", "elbow_joint"]')
    dataset = import_logs([log], load_map(write_map(tmp_path, text))).dataset
    time = dataset.columns["nas.time"][:, 0]
    truth = np.column_stack([angle(time)[:, 0], angle(time - 1e-3)[:, 1]])
    np.testing.assert_allclose(dataset.states[:, :2], truth, atol=1e-6)


def test_components_are_picked_by_number_only_where_the_names_stay_in_one_order(tmp_path):
    def pick(text):
        return unnamed(text).replace('column = "position"', 'column = "position"\ncomponents = [2, 0]')

    write_json_mcap(tmp_path / "bag.mcap")
    with pytest.raises(MapError, match=r"picks 'components' .* row 0 .* names shoulder, elbow, wrist, and row 1 "):
        import_bag(tmp_path, pick)
    write_messages(tmp_path / "bag.mcap", change_state=one_order)
    with pytest.raises(MapError, match="picks component 0 for the joint 'shoulder', but there it is 'elbow'"):
        import_bag(tmp_path, lambda text: pick(text).replace("[2, 0]", "[0, 2]"))
    found = import_bag(tmp_path, pick)
    np.testing.assert_allclose(found.states[:, :2], angle(found.columns["nas.time"][:, 0]), atol=1e-6)


def one_order(message):
    """The same message with its joints in one order; a message of the gripper is as it was."""
    if "wrist" not in message["name"]:
        return message
    held = dict(zip(message["name"], message["position"], strict=True))
    return {**message, "name": list(NAMES), "position": [held[name] for name in NAMES]}


def test_messages_that_need_some_time_to_arrive_have_no_other_clock(tmp_path):
    def late(message):
        """Stamp a message 30 ms before it is received."""
        stamp = message["header"]["stamp"]
        seconds, rest = divmod(stamp["sec"] * 1_000_000_000 + stamp["nanosec"] - 30_000_000, 1_000_000_000)
        return {**message, "header": {"stamp": {"sec": seconds, "nanosec": rest}}}

    write_messages(tmp_path / "bag.mcap", change_state=late)
    assert import_bag(tmp_path).n_frames > 190


def test_stamps_of_foxglove_and_of_ros_1_are_times(tmp_path):
    for seconds, nanoseconds in (("sec", "nsec"), ("secs", "nsecs")):

        def rename(message, keys=(seconds, nanoseconds)):
            stamp = message["header"]["stamp"]
            return {**message, "header": {"stamp": dict(zip(keys, stamp.values(), strict=True))}}

        write_messages(tmp_path / "bag.mcap", change_state=rename)
        assert import_bag(tmp_path).n_frames == 199


def test_clocks_that_differ_are_not_joined(tmp_path):
    def late(message):
        stamp = message["header"]["stamp"]
        return {**message, "header": {"stamp": {**stamp, "sec": stamp["sec"] + 3}}}

    write_messages(tmp_path / "bag.mcap", change_state=late)
    with pytest.raises(
        LogError, match=r"are 3 s behind those of /joint_states.*set column = 'log_time' for all topics"
    ):
        import_bag(tmp_path)
    by_receipt = 'column = "log_time"'
    assert import_bag(tmp_path, lambda text: text.replace('column = "header.stamp"', by_receipt)).n_frames == 199


def test_a_bag_without_channels_in_its_summary_is_read(tmp_path):
    write_messages(tmp_path / "bag.mcap", repeat_channels=False, repeat_schemas=False, use_statistics=False)
    assert import_bag(tmp_path).n_frames == 199


def test_messages_of_another_encoding_are_not_called_damaged(tmp_path):
    write_messages(tmp_path / "bag.mcap", encoding="protobuf")
    with pytest.raises(LogError, match="has messages in the encoding protobuf; only ROS 2"):
        import_bag(tmp_path)


def test_fields_that_some_messages_lack_are_named_by_row(tmp_path):
    measured = '[read.velocity]\ntopic = "state"\ncolumn = "velocity"\nunit = "rad/s"\n'

    def without_some(message, key="velocity"):
        lost = message["header"]["stamp"]["nanosec"] == 40_000_000
        values = {} if lost and key == "position" else {key: [] if lost else [1.0] * len(message["name"])}
        return {**{name: value for name, value in message.items() if name != key}, **values}

    write_messages(tmp_path / "bag.mcap", change_state=without_some)
    with pytest.raises(LogError, match=r"'velocity' holds 3 numbers in row 0 .* and 0 in row 2 .*velocity = 'derive'"):
        import_bag(tmp_path, lambda text: text.replace('"derive"', '"measured"') + measured)
    write_messages(tmp_path / "bag.mcap", change_state=lambda message: without_some(message, "position"))
    with pytest.raises(LogError, match="the position is empty, NaN or infinite in rows 2, "):
        import_bag(tmp_path)


@pytest.mark.parametrize("empty", [[], [float("nan")] * 3])
def test_fields_that_no_message_has_are_left_out_of_the_map_as_is_said(tmp_path, empty):
    right = import_bag(write_json_mcap(tmp_path / "bag.mcap").parent)
    measured = '[read.velocity]\ntopic = "state"\ncolumn = "velocity"\nunit = "rad/s"\n'
    load = '[signals.load]\ntopic = "state"\ncolumn = "effort"\nunit = "N·m"\n'

    def without(message):
        absent = empty[: len(message["name"])]
        return {**message, "velocity": absent, "effort": absent}

    write_messages(tmp_path / "bag.mcap", change_state=without)
    with pytest.raises(LogError, match=r"empty.* in all rows; .* set velocity = 'derive' and remove \[read.velocity\]"):
        import_bag(tmp_path, lambda text: text.replace('"derive"', '"measured"') + measured)
    with pytest.raises(LogError, match=r"empty.* in all rows; remove \[signals.load\]"):
        import_bag(tmp_path, lambda text: text + load)
    np.testing.assert_array_equal(import_bag(tmp_path).states, right.states)


EACH = """
format = "{format}"
robot = "bagged"
joints = ["shoulder", "elbow"]
rate = 50.0
alignment = "action_follows_state"
velocity = "derive"
[topics]
shoulder = "/shoulder/state"
elbow = "/elbow/state"
shoulder_goal = "/shoulder/command"
elbow_goal = "/elbow/command"
[join]
method = "previous"
tolerance = 0.2
[read.time]
column = "log_time"
unit = "ns"
[read.position]
topic = ["shoulder", "elbow"]
column = "{position}"
unit = "deg"
[read.command]
topic = ["shoulder_goal", "elbow_goal"]
column = "data"
unit = "deg"
[read.command.joints.elbow]
sign = -1
"""


def write_topics_of_joints(path, make_state):
    """Two joints at 50 Hz, the elbow 1 ms ahead; goals at 20 and 10 Hz, the elbow's with the other sign."""
    times = START + np.arange(200) * 20_000_000
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("any", "jsonschema", b"{}")
        for index, joint in enumerate(("shoulder", "elbow")):
            state = writer.register_channel(f"/{joint}/state", "json", schema)
            goal = writer.register_channel(f"/{joint}/command", "json", schema)
            for time in (times - index * 1_000_000).tolist():
                content = make_state(joint, np.degrees(angle((time - START) / 1e9)[index]))
                writer.add_message(state, log_time=time, data=json.dumps(content).encode(), publish_time=time)
            for number in range(-1, 80):
                time = START + 5_000_000 + number * (50_000_000, 100_000_000)[index]
                data = json.dumps({"data": (number, -number)[index]}).encode()
                writer.add_message(goal, log_time=time, data=data, publish_time=time)
        writer.finish()
    return path


@pytest.mark.parametrize("named", [False, True])
def test_each_joint_may_have_topics_of_its_own(tmp_path, named):
    def make_state(joint, value):
        return {"name": ["other", joint], "position": [9.0, value]} if named else {"data": value}

    log = write_topics_of_joints(tmp_path / "bag.mcap", make_state)
    text = EACH.format(format="mcap", position="position" if named else "data")
    dataset = import_logs([log], load_map(write_map(tmp_path, 'joint_names = "name"\n' * named + text))).dataset
    time = dataset.columns["nas.time"][:, 0]
    assert dataset.n_frames > 90
    truth = np.column_stack([angle(time)[:, 0], angle(time - 1e-3)[:, 1]])
    np.testing.assert_allclose(dataset.states[:, :2], truth, atol=1e-6)
    last = np.floor(np.column_stack([(time + 0.005) / 0.05, (time + 0.005) / 0.1]) + 1e-6)
    np.testing.assert_allclose(np.degrees(dataset.commands), last, atol=1e-4)


@pytest.mark.parametrize(
    ("given", "instead", "sentence"),
    [
        ('["shoulder", "elbow"]\ncolumn', '["shoulder"]\ncolumn', "'topic' names 1 topic; 2 are needed, one a joint"),
        ('["shoulder", "elbow"]\ncolumn', '["shoulder", "shoulder"]\ncolumn', "'topic' names 'shoulder' twice"),
        (
            '["shoulder", "elbow"]\ncolumn',
            '["shoulder", "knee"]\ncolumn',
            "'topic' names 'knee'; choose among: shoulder",
        ),
    ],
)
def test_topics_of_joints_that_do_not_fit_are_refused(tmp_path, given, instead, sentence):
    text = EACH.format(format="mcap", position="data")
    with pytest.raises(MapError, match=sentence):
        load_map(write_map(tmp_path, text.replace(given, instead)))


def test_each_joint_may_have_a_file_of_its_own(tmp_path):
    take = tmp_path / "take"
    take.mkdir()
    time = np.arange(100) / 50
    for index, joint in enumerate(("shoulder", "elbow")):
        rows = np.column_stack([time, angle(time)[:, index], angle(time + 0.1)[:, index]])
        np.savetxt(take / f"{joint}.csv", rows, delimiter=",", header="t,q,goal", comments="")
    (tmp_path / "map.toml").write_text(
        """
format = "csv"
robot = "files"
joints = ["shoulder", "elbow"]
rate = 50.0
alignment = "action_follows_state"
velocity = "derive"
[files]
first = "shoulder.csv"
second = "elbow.csv"
[join]
method = "nearest"
tolerance = 0.001
[read.time]
column = "t"
unit = "s"
[read.position]
file = ["first", "second"]
column = "q"
unit = "rad"
[read.command]
file = ["first", "second"]
columns = ["goal", "goal"]
unit = "rad"
"""
    )
    dataset = import_logs([take], load_map(tmp_path / "map.toml")).dataset
    np.testing.assert_allclose(dataset.states[:, :2], angle(time[:99]), atol=1e-6)
    np.testing.assert_allclose(dataset.commands, angle(time[:99] + 0.1), atol=1e-6)


def test_publishers_that_share_a_topic_are_told_apart_by_the_names_in_their_messages(tmp_path):
    write_messages(tmp_path / "bag.mcap", change_command=lambda message: {"data": [*message["data"], 0.0]})

    def add_gripper(text):
        return text.replace('"elbow"]', '"elbow", "gripper"]').replace("tolerance = 0.06", "tolerance = 0.11")

    with pytest.raises(LogError, match=r"set topic = \[one per joint\]"):
        import_bag(tmp_path, add_gripper)

    def apart(text):
        once = "".join(f'{joint} = "/joint_states"\n' for joint in ("shoulder", "elbow", "gripper"))
        listed = '["shoulder", "elbow", "gripper"]'
        text = add_gripper(text).replace('state = "/joint_states"\n', once)
        return text.replace('topic = "state"', f"topic = {listed}")

    dataset = import_bag(tmp_path, apart)
    time = dataset.columns["nas.time"][:, 0]
    assert dataset.joints == ("shoulder", "elbow", "gripper")
    np.testing.assert_allclose(dataset.states[:, :3], np.column_stack([angle(time), 0 * time]), atol=1e-6)


def test_a_topic_without_messages_is_left_or_the_bag_that_has_them_given(tmp_path):
    write_messages(tmp_path / "bag.mcap", unheard=["/goals"])

    def goals(text):
        return text.replace('"/commands"', '"/goals"')

    with pytest.raises(
        LogError, match=r"bag\.mcap has no messages of '/goals'; give the bag that has, or correct \[topics\]"
    ):
        import_bag(tmp_path, goals)
    assert import_bag(tmp_path).n_frames == 199
    write_messages(tmp_path / "bag.mcap", commanded="/goals")
    assert import_bag(tmp_path, goals).n_frames == 199


def test_topics_are_corrected_to_those_that_the_bag_is_said_to_have(tmp_path):
    write_messages(tmp_path / "bag.mcap", commanded="/goals")
    with pytest.raises(LogError, match=r"no topic '/commands', which \[topics\] of the map names; it has: /goals, /jo"):
        import_bag(tmp_path)
    assert import_bag(tmp_path, lambda text: text.replace('"/commands"', '"/goals"')).n_frames == 199


def test_other_messages_are_read_once_they_are_converted_as_is_said(tmp_path):
    write_messages(tmp_path / "bag.mcap", encoding="cbor")
    with pytest.raises(
        LogError, match=r"encoding cbor; .*: convert the topics of the map to one of them, or to a CSV file"
    ):
        import_bag(tmp_path)
    assert import_bag(write_json_mcap(tmp_path / "bag.mcap").parent).n_frames == 199


def test_joints_without_a_topic_each_are_given_one_as_is_said(tmp_path):
    write_topics_of_joints(tmp_path / "bag.mcap", lambda joint, value: {"data": value})
    text = EACH.format(format="mcap", position="data")
    wrong = text.replace('["shoulder", "elbow"]\ncolumn', '["shoulder"]\ncolumn')
    with pytest.raises(MapError, match=r"\[read.position\]: 'topic' names 1 topic; 2 are needed, one a joint\."):
        load_map(write_map(tmp_path, wrong))
    assert import_logs([tmp_path / "bag.mcap"], load_map(write_map(tmp_path, text))).dataset.n_frames > 90


def test_a_bag_is_given_where_a_folder_is_none_as_is_said(tmp_path):
    mapping = load_map(write_map(tmp_path, MAP.format(format="rosbag")))
    (tmp_path / "logs.bag").mkdir()
    with pytest.raises(LogError, match=r"logs\.bag cannot be read: .*; give a ROS 2 bag\."):
        read_tables(tmp_path / "logs.bag", mapping.layout)
    assert import_logs([write_rosbag(tmp_path / "bag")], mapping).dataset.n_frames == 199
