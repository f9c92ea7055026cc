"""MCAP files and ROS bags of two topics with different rates, and the map that joins them."""

import json
from pathlib import Path

import numpy as np

START = 1_700_000_000_000_000_000  # [ns]
NAMES = ("elbow", "wrist", "shoulder")  # the topic holds one more joint than the map
JOINT_STATE = """std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
COMMANDS = """std_msgs/MultiArrayLayout layout
float64[] data
================================================================================
MSG: std_msgs/MultiArrayLayout
std_msgs/MultiArrayDimension[] dim
uint32 data_offset
================================================================================
MSG: std_msgs/MultiArrayDimension
string label
uint32 size
uint32 stride
"""


def angle(time: np.ndarray) -> np.ndarray:
    """Positions of shoulder and elbow [rad] at some times [s]."""
    return 0.6 * np.sin(np.asarray(time)[..., None] * [2.0, 3.0])


def states(order_changes: bool = True) -> list[tuple[int, dict]]:
    """Joint states at 50 Hz for 4 s; names in another order in every other message, a gripper's messages between."""
    found = []
    for row in range(200):
        time = row / 50
        values = {**dict(zip(("shoulder", "elbow"), angle(time), strict=True)), "wrist": 9.0}
        names = NAMES if row % 2 or not order_changes else ("shoulder", "elbow", "wrist")
        stamp = START + round(time * 1e9)
        state = {"name": list(names), "position": [values[name] for name in names]}
        found.append((stamp, state))
        if row % 10 == 3:
            found.append((stamp + 1_000_000, {"name": ["gripper"], "position": [0.0]}))
    return found


def commands() -> list[tuple[int, list[float]]]:
    """Goals at 20 Hz, in the map's order."""
    return [(START + 2_000_000 + round(k / 20 * 1e9), angle(k / 20 + 0.1).tolist()) for k in range(-1, 80)]


def header(time: int) -> dict:
    return {"stamp": {"sec": time // 10**9, "nanosec": time % 10**9}, "frame_id": ""}


def write_mcap(path: Path) -> Path:
    from mcap_ros2.writer import Writer

    with path.open("wb") as file:
        writer = Writer(file)
        state = writer.register_msgdef("sensor_msgs/msg/JointState", JOINT_STATE)
        command = writer.register_msgdef("std_msgs/msg/Float64MultiArray", COMMANDS)
        for time, content in states():
            message = {"header": header(time), **content, "velocity": [], "effort": []}
            writer.write_message("/joint_states", state, message, log_time=time, publish_time=time)
        for time, goal in commands():
            message = {"layout": {"dim": [], "data_offset": 0}, "data": goal}
            writer.write_message("/commands", command, message, log_time=time, publish_time=time)
        writer.finish()
    return path


def write_json_mcap(path: Path) -> Path:
    from mcap.writer import Writer

    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("any", "jsonschema", b"{}")
        topics = {name: writer.register_channel(name, "json", schema) for name in ("/joint_states", "/commands")}
        for time, content in states():
            data = json.dumps({"header": header(time), **content}).encode()
            writer.add_message(topics["/joint_states"], log_time=time, data=data, publish_time=time)
        for time, goal in commands():
            data = json.dumps({"data": goal}).encode()
            writer.add_message(topics["/commands"], log_time=time, data=data, publish_time=time)
        writer.finish()
    return path


def write_rosbag(path: Path) -> Path:
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    kinds = store.types
    with Writer(path, version=9) as bag:
        state = bag.add_connection("/joint_states", "sensor_msgs/msg/JointState", typestore=store)
        command = bag.add_connection("/commands", "std_msgs/msg/Float64MultiArray", typestore=store)
        for time, content in states():
            stamp = kinds["builtin_interfaces/msg/Time"](sec=time // 10**9, nanosec=time % 10**9)
            message = kinds["sensor_msgs/msg/JointState"](
                header=kinds["std_msgs/msg/Header"](stamp=stamp, frame_id=""),
                name=content["name"],
                position=np.array(content["position"]),
                velocity=np.array([]),
                effort=np.array([]),
            )
            bag.write(state, time, store.serialize_cdr(message, "sensor_msgs/msg/JointState"))
        layout = kinds["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
        for time, goal in commands():
            message = kinds["std_msgs/msg/Float64MultiArray"](layout=layout, data=np.array(goal))
            bag.write(command, time, store.serialize_cdr(message, "std_msgs/msg/Float64MultiArray"))
    return path


MAP = """
format = "{format}"
robot = "bagged"
joints = ["shoulder", "elbow"]
joint_names = "name"
rate = 50.0
alignment = "action_follows_state"
velocity = "derive"
[topics]
state = "/joint_states"
command = "/commands"
[join]
method = "previous"
tolerance = 0.06
[read.time]
column = "header.stamp"
unit = "ns"
columns = {{command = "log_time"}}
[read.position]
topic = "state"
column = "position"
unit = "rad"
[read.command]
topic = "command"
column = "data"
unit = "rad"
"""
