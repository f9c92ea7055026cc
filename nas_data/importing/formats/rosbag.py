"""ROS bags: the folder of a ROS 2 bag or the file of a ROS 1 bag, one table per topic."""

import shlex
from collections.abc import Iterator
from pathlib import Path

from rosbags.highlevel import AnyReader, AnyReaderError
from rosbags.rosbag1 import ReaderError as Reader1Error
from rosbags.rosbag2 import ReaderError as Reader2Error
from rosbags.typesys import Stores, get_typestore

from nas_data.errors import LogError
from nas_data.importing.layout import LogLayout
from nas_data.importing.messages import to_tables
from nas_data.importing.table import LogTable
from nas_data.visible_files import list_visible_files

SUFFIXES = (".bag",)
FOLDER = "a ROS 2 bag"


def is_log(path: Path) -> bool:
    """Return whether a folder is a ROS 2 bag, possibly without metadata, which recorders write last."""
    return any(file.name == "metadata.yaml" or file.suffix in (".db3", ".mcap") for file in list_visible_files(path))


def read_topics(path: Path, layout: LogLayout) -> dict[str, LogTable]:
    """Read the topics of the map."""
    try:
        return to_tables(path, dict(layout.topics), _read_messages(path, layout))
    except (AnyReaderError, Reader1Error, Reader2Error, FileNotFoundError) as error:
        reason = (str(error) or type(error).__name__).splitlines()[0].rstrip(".")
        where = shlex.quote(str(path))
        command = f"ros2 bag reindex {where}" if path.is_dir() else f"rosbag reindex {where}"
        raise LogError(f"{path} cannot be read as a bag: {reason}; copy it again, or reindex it ({command}).") from None


def _read_messages(path: Path, layout: LogLayout) -> Iterator[tuple[str, int, object]]:
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        wanted = [connection for connection in reader.connections if connection.topic in layout.topics.values()]
        there = sorted({connection.topic for connection in reader.connections})
        missing = next((topic for topic in layout.topics.values() if topic not in there), None)
        if missing is not None:
            listed = ", ".join(there) or "none"
            raise LogError(f"{path} has no topic '{missing}', which [topics] of the map names; it has: {listed}.")
        for connection, time, raw in reader.messages(connections=wanted):
            yield connection.topic, time, reader.deserialize(raw, connection.msgtype)
