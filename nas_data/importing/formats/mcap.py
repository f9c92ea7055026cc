"""MCAP: messages of ROS 2 or JSON, one table per topic."""

import json
import shlex
from collections.abc import Callable, Iterator
from pathlib import Path

from mcap.decoder import DecoderFactory
from mcap.exceptions import DecoderNotFoundError, McapError
from mcap.reader import NonSeekingReader, make_reader
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory as Ros2

from nas_data.errors import LogError
from nas_data.importing.layout import LogLayout
from nas_data.importing.messages import to_tables
from nas_data.importing.table import LogTable

SUFFIXES = (".mcap",)


def read_topics(path: Path, layout: LogLayout) -> dict[str, LogTable]:
    """Read the topics of the map."""
    try:
        return to_tables(path, dict(layout.topics), _read_messages(path, layout))
    except DecoderNotFoundError as error:
        encoding = str(error).partition(" message encoding ")[2].partition(",")[0]
        raise LogError(
            f"{path} has messages in the encoding {encoding}; only ROS 2 (cdr) and JSON can be read: convert the "
            "topics of the map to one of them, or to a CSV file."
        ) from None
    except McapError as error:
        reason = (str(error) or type(error).__name__).splitlines()[0].rstrip(".")
        raise LogError(
            f"{path} is damaged or cut off ({reason}); copy it again, or repair it with the program of "
            f"https://mcap.dev/guides/cli (mcap recover {shlex.quote(str(path))} -o repaired.mcap)."
        ) from None


def _read_messages(path: Path, layout: LogLayout) -> Iterator[tuple[str, int, object]]:
    with path.open("rb") as file:
        decoders = [Ros2(), _Json()]
        reader = make_reader(file, decoder_factories=decoders)
        summary = reader.get_summary()
        there = {channel.topic for channel in summary.channels.values()} if summary else set()
        if not there:  # no summary, because the recorder was killed or omitted it; its channels are among the messages
            file.seek(0)
            reader = NonSeekingReader(file, decoder_factories=decoders)
        missing = next((topic for topic in layout.topics.values() if there and topic not in there), None)
        if missing is not None:
            found = ", ".join(sorted(there))
            raise LogError(f"{path} has no topic '{missing}', which [topics] of the map names; it has: {found}.")
        for _, channel, message, decoded in reader.iter_decoded_messages(topics=list(layout.topics.values())):
            yield channel.topic, message.log_time, decoded


class _Json(DecoderFactory):
    """Decodes JSON messages."""

    def decoder_for(self, message_encoding: str, schema: Schema | None) -> Callable[[bytes], object] | None:
        """Return the decoder of an encoding; None for others."""
        return json.loads if message_encoding == "json" else None
