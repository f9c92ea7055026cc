"""Layout of a log on disk: files, format, and the join of several tables."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from nas_data.importing.section import MapSection

BAGS = ("mcap", "rosbag")  # formats whose tables are topics
JOINS = ("nearest", "previous")
DECIMALS = (".", ",")


@dataclass(frozen=True)
class LogLayout:
    """Layout of a log on disk.

    Attributes:
        format: File format, a file of `importing/formats/`.
        pattern: File name pattern of the logs in a folder.
        files: File name of each table if a log is a folder of several files; empty if a log is one file.
        join: How rows of several tables are joined on time: with the nearest row, or with the previous one. Commands
            that act after their state may be up to half a step later than it.
        tolerance: Largest difference of two joined times [s].
        topics: Topic of each table if a log is a bag of messages; else empty.
        entries: JSON key that holds a list of rows; empty if a file holds one list per column.
        delimiter: Separator of the cells of a CSV file.
        decimal: Its decimal separator, a point or a comma.
    """

    format: str
    pattern: str = "*"
    files: Mapping[str, str] | None = None
    topics: Mapping[str, str] = field(default_factory=dict)
    join: str = "nearest"
    tolerance: float = 1e-3
    entries: str = ""
    delimiter: str = ","
    decimal: str = "."

    @property
    def tables(self) -> tuple[str, Mapping[str, str]]:
        """The map's key that selects a quantity's table, and its choices; empty if a log is one file."""
        return ("topic", self.topics) if self.topics else ("file", self.files or {})


def parse_layout(top: MapSection, formats: tuple[str, ...]) -> LogLayout:
    """Read the keys of a log's layout.

    Raises:
        MapError: a key is missing, unknown or out of its range.
    """
    name = top.text("format", choices=formats)
    files = top.table("files")
    tables = {key: files.text(key) for key in files.values}
    topics = _parse_topics(top, name)
    several = len(tables) > 1 or len(topics) > 1
    _refuse_keys_of_others(top, name, several)
    join = top.table("join") if several else MapSection({}, top.file)
    layout = LogLayout(
        format=name,
        pattern=top.text("pattern", "*"),
        files=tables or None,
        topics=topics,
        join=join.text("method", None if several else JOINS[0], choices=JOINS),
        tolerance=join.positive("tolerance", None if several else 1.0),
        entries=top.text("entries", "") if name == "json" else "",
        delimiter=top.text("delimiter", ",") if name == "csv" else ",",
        decimal=top.text("decimal", DECIMALS[0], choices=DECIMALS) if name == "csv" else DECIMALS[0],
    )
    join.finish()
    return layout


def _parse_topics(top: MapSection, name: str) -> dict[str, str]:
    """Read the topic of each table of a bag."""
    if name not in BAGS:
        top.refuse("topics", " or ".join(f"format = '{bag}'" for bag in BAGS))
        return {}
    section = top.table("topics")
    topics = {key: section.text(key) for key in section.values}
    if not topics:
        raise top.error("[topics] is missing; name the topics to read, for example state = '/joint_states'.")
    return topics


def _refuse_keys_of_others(top: MapSection, name: str, several: bool) -> None:
    """Refuse keys of other formats and layouts."""
    if name != "json":
        top.refuse("entries", "format = 'json'")
    if name != "csv":
        top.refuse("delimiter", "format = 'csv'")
        top.refuse("decimal", "format = 'csv'")
    if not several:
        top.refuse("join", "logs of several [files] or [topics]")
