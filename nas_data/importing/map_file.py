"""Reading and validation of a map's TOML file."""

import string
import tomllib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from nas_data.count_of import count_of
from nas_data.errors import MapError, UnknownName
from nas_data.importing.conversion import (
    FACTORS,
    OF_EITHER,
    OF_SLIDES,
    SI,
    TIME_UNITS,
    Kind,
    check_encoding,
    parse_conversion,
)
from nas_data.importing.formats import FORMATS
from nas_data.importing.layout import LogLayout, parse_layout
from nas_data.importing.map import (
    ALIGNMENTS,
    KEPT_VELOCITY,
    LogColumns,
    LogQuantity,
    Map,
    Resample,
    ServoTicks,
    Thresholds,
    TimeColumn,
)
from nas_data.importing.section import MapSection
from nas_data.visible_files import list_visible_files

MAPS = Path(__file__).parent / "maps"
VELOCITIES = ("measured", "derive")
METHODS = ("linear", "previous")
ALLOWABLE = ("command_scale", "rate", "unit_slip", "unmatched_ends", "velocity_scale")


def load_map(name_or_path: str | Path) -> Map:
    """Read a map by its path, or an included one by its name.

    Raises:
        MapError: the file is missing or no TOML, or a key is missing, unknown or of the wrong type.
        UnknownName: the name is neither a file nor an included map.
    """
    path = Path(name_or_path)
    shipped = {file.stem: file for file in list_visible_files(MAPS, "*.toml")}
    robots = [name.rpartition("_")[0] for name in shipped]
    alone = [robot for robot in robots if robots.count(robot) == 1 and f"{robot}_lerobot" in shipped]
    shipped |= {robot: shipped[f"{robot}_lerobot"] for robot in alone}
    if not path.is_file() and not path.suffix and len(path.parts) == 1:
        if str(name_or_path) not in shipped:
            raise UnknownName("map", str(name_or_path), shipped, "or give the path of a TOML file")
        path = shipped[str(name_or_path)]
    try:
        text = path.read_text(encoding="utf-8-sig")  # Windows' Notepad begins UTF-8 with a byte order mark
        values = tomllib.loads(text)
    except FileNotFoundError:
        raise MapError(f"There is no map {path}; give a TOML file or one of: {', '.join(sorted(shipped))}.") from None
    except (OSError, UnicodeDecodeError) as error:
        raise MapError(f"{path} cannot be read as a map ({type(error).__name__}); give a TOML file.") from None
    except tomllib.TOMLDecodeError as error:
        raise MapError(f"{path} is not valid TOML: {error}.") from None
    return parse_map(MapSection(values, str(path)), path.stem, text)


def parse_map(top: MapSection, name: str, text: str) -> Map:
    """Read the whole map."""
    joints = top.texts("joints")
    if not joints or len(set(joints)) < len(joints):
        raise top.error(f"'joints' is {list(joints)}; it must name each joint once.")
    layout = parse_layout(top, FORMATS)
    lerobot = layout.format == "lerobot"
    read = top.table("read")
    derive = top.text("velocity", choices=VELOCITIES) == "derive"
    quantities = _Quantities(joints, layout, keeps_velocity=derive and read.has("velocity"))
    if not derive and not read.has("velocity"):
        raise top.error("'velocity' is 'measured' but there is no [read.velocity]; add it, or set velocity = 'derive'.")
    constants = top.texts("constants", ("task",) if lerobot else ())
    parsed = Map(
        name=name,
        text=text,
        layout=layout,
        robot=top.text("robot"),
        joints=joints,
        rate=top.positive("rate") if not lerobot or top.has("rate") else 0.0,
        alignment=top.text("alignment", choices=ALIGNMENTS),
        derive_velocity=derive,
        clock=_parse_clock(read.table("time")) if not lerobot or read.has("time") else TimeColumn("timestamp", "s"),
        position=quantities.parse(read.table("position"), "position", "position"),
        velocity=quantities.parse(read.table("velocity"), "velocity", "velocity") if read.has("velocity") else None,
        command=quantities.parse(read.table("command"), "command", "command"),
        signals={key: quantities.parse(table, key, "signal") for key, table in top.table("signals").tables().items()},
        episode=_parse_episode(read, layout),
        slides=frozenset(),
        limits=_parse_limits(top.table("limits"), joints),
        thresholds=_parse_thresholds(top.table("audit")),
        resample=_parse_resample(top.table("resample")) if top.has("resample") else None,
        constants=constants,
        task=_parse_task(top, constants, "{task}" if lerobot and "task" in constants else "{log}"),
        joint_names=top.text("joint_names", ""),
        servo=_parse_servo(top.table("servo")) if lerobot and top.has("servo") else None,
    )
    slides = _find_slides(top, parsed)
    read.finish()
    top.finish()
    return replace(parsed, slides=slides)


def _find_slides(top: MapSection, parsed: Map) -> frozenset[str]:
    """Return the slides: joints in a unit of length, and those that `slides` names."""
    named = top.texts("slides", ())
    unknown = [joint for joint in named if joint not in parsed.joints]
    if unknown:
        raise top.error(f"'slides' names '{unknown[0]}'; the joints are: {', '.join(parsed.joints)}.")
    units = dict(zip(parsed.joints, parsed.position.conversion.units, strict=True))
    slides = frozenset(joint for joint, unit in units.items() if joint in named or unit in OF_SLIDES)
    for quantity in filter(None, (parsed.position, parsed.velocity, parsed.command)):
        for joint, unit, kind in zip(parsed.joints, quantity.conversion.units, quantity.conversion.kinds, strict=True):
            slide = joint in slides
            if unit not in OF_EITHER and (unit in OF_SLIDES) != slide:
                own = top.table("read").table(quantity.name).table("joints").table(joint)
                where = own.name if own.has("unit") else f"read.{quantity.name}"
                fitting = [one for one in FACTORS[kind] if one in OF_EITHER or (one in OF_SLIDES) == slide]
                reason, otherwise = _explain_kind(joint, units[joint], joint in named)
                raise top.error(
                    f"'{joint}' is {'a slide' if slide else 'a hinge'}, because {reason}, but its unit in [{where}] is "
                    f"'{unit}'; choose one of: {', '.join(fitting)}; or {otherwise}."
                )
    return slides


def _explain_kind(joint: str, unit: str, named: bool) -> tuple[str, str]:
    """Return the reason why a joint counts as a slide or hinge, and how to change that.

    Args:
        joint: Name of the joint.
        unit: Unit of its positions in the map.
        named: Whether `slides` names it.
    """
    if unit in OF_SLIDES:
        also = f" and remove '{joint}' from 'slides'" if named else ""
        return f"its positions are in '{unit}'", f"correct the unit of its positions{also}"
    if named:
        return "'slides' names it", f"remove '{joint}' from 'slides'"
    if unit in OF_EITHER:
        return f"its positions are in '{unit}' and 'slides' does not name it", f"name '{joint}' in 'slides'"
    return f"its positions are in '{unit}'", "correct the unit of its positions"


class _Quantities:
    """Reads quantities with common joints and layout."""

    def __init__(self, joints: Sequence[str], layout: LogLayout, keeps_velocity: bool) -> None:
        """Initialize.

        Args:
            joints: Names of the joints.
            layout: Layout of a log on disk.
            keeps_velocity: Whether the velocities that are read become a signal, as those of the state are derived.
        """
        self.joints = joints
        self.layout = layout
        self.keeps_velocity = keeps_velocity

    def parse(self, section: MapSection, name: str, kind: Kind) -> LogQuantity:
        """Read source, conversion and encoding of a quantity."""
        self._check_signal_name(section, name, kind)
        scalar = kind == "signal" and section.flag("whole_robot")
        joints = ("robot",) if scalar else self.joints
        source = _parse_source(section, self.layout, len(joints), kind == "signal")
        encoding = check_encoding(section)
        conversion = parse_conversion(section, kind, joints)
        section.finish()
        unit = SI.get(kind) or conversion.units[0]
        return LogQuantity(name, unit, source, conversion, encoding)

    def _check_signal_name(self, section: MapSection, name: str, kind: Kind) -> None:
        if kind == "signal" and (name == "time" or not name.replace("_", "").isalnum() or "image" in name):
            raise section.error(
                f"'{name}' cannot name a signal; use letters, digits and _, neither 'time' nor 'image'."
            )
        if kind == "signal" and name == KEPT_VELOCITY and self.keeps_velocity:
            raise section.error(
                f"'{name}' cannot name a signal, because velocity = 'derive' keeps those of [read.velocity] by this "
                "name; give the signal another name."
            )


def _parse_source(section: MapSection, layout: LogLayout, width: int, may_be_constant: bool) -> LogColumns:
    """Read the location of a quantity: its file, and `column`, `columns` or (signals only) `constant`."""
    keys = ["column", "columns", "constant"] if may_be_constant else ["column", "columns"]
    standard = {"position": "observation.state", "command": "action"}.get(section.name.rpartition(".")[2])
    if layout.format == "lerobot" and standard and not any(section.has(key) for key in keys):
        return LogColumns((standard,), names=_parse_names(section, width))
    given = [key for key in keys if section.has(key)]
    if len(given) != 1:
        raise section.error(f"exactly one of {' or '.join(repr(key) for key in keys)} is needed.")
    columns = section.texts("columns") if given == ["columns"] else (section.text(given[0]),)
    if given == ["columns"] and len(columns) != width:
        raise section.error(f"'columns' names {count_of(len(columns), 'column')}; {width} are needed, one a joint.")
    tables = _parse_tables_of_joints(section, layout, width)
    if tables and given != ["constant"]:
        names = _parse_names(section, width)
        return LogColumns(columns * (width // len(columns)), tables[0], names=names, tables=tables)
    # A signal may share a component between joints, a state or command may not.
    if not may_be_constant:
        _refuse_twice(section, "columns", columns)
    components = section.integers("components") if section.has("components") else ()
    if components and (given != ["column"] or len(components) != width):
        raise section.error(f"'components' picks {count_of(width, 'component')} out of one 'column', one a joint.")
    if not may_be_constant:
        _refuse_twice(section, "components", components)
    table = _parse_table_name(section, layout)
    named = section.has("names") and not components and given == ["column"]
    names = _parse_names(section, width) if named else ()
    return LogColumns(columns, table, components, constant=given == ["constant"], names=names)


def _parse_names(section: MapSection, width: int) -> tuple[str, ...]:
    """Read the names of a vector's components in the log."""
    names = section.texts("names", ())
    if names and (len(names) != width or len(set(names)) < len(names)):
        raise section.error(f"'names' is {list(names)}; it must name {width} different components, one a joint.")
    return names


def _parse_servo(section: MapSection) -> ServoTicks:
    """Read the servo properties behind LeRobot's units."""
    servo = ServoTicks(resolution=int(section.positive("resolution", 4096.0)), drive_mode=section.flag("drive_mode"))
    section.finish()
    return servo


def _refuse_twice(section: MapSection, key: str, chosen: Sequence[str | int]) -> None:
    """Refuse a column or component that is used for two joints."""
    twice = [one for one in chosen if chosen.count(one) > 1]
    if twice:
        raise section.error(f"'{key}' names {twice[0]!r} twice; each joint has its own.")


def _parse_tables_of_joints(section: MapSection, layout: LogLayout, width: int) -> tuple[str, ...]:
    """Read the keys of files or topics that hold one joint each; empty for a single key."""
    key, tables = layout.tables
    if not isinstance(section.values.get(key), list):
        return ()
    chosen = section.texts(key)
    if len(chosen) != width:
        raise section.error(f"'{key}' names {count_of(len(chosen), key)}; {width} are needed, one a joint.")
    _refuse_twice(section, key, chosen)
    unknown = next((one for one in chosen if one not in tables), None)
    if unknown is not None:
        raise section.error(f"'{key}' names '{unknown}'; choose among: {', '.join(tables)}.")
    return chosen


def _parse_table_name(section: MapSection, layout: LogLayout) -> str:
    """Read the key of the log's file or topic."""
    key, tables = layout.tables
    if not tables:
        return ""
    return section.text(key, next(iter(tables)) if len(tables) == 1 else None, choices=tuple(tables))


def _parse_episode(read: MapSection, layout: LogLayout) -> LogColumns | None:
    """Read the episode column; every dataset has one."""
    if not read.has("episode"):
        return LogColumns(("episode_index",)) if layout.format == "lerobot" else None
    section = read.table("episode")
    source = LogColumns((section.text("column"),), _parse_table_name(section, layout))
    section.finish()
    return source


def _parse_clock(section: MapSection) -> TimeColumn:
    """Read the source of the time; evenly spaced rows without a clock must be declared."""
    given = section.has("column")
    if section.flag("uniform"):
        if given:
            raise section.error(
                "uniform = true is for logs without a time: leave out either it, or 'column' and 'unit'."
            )
        clock = TimeColumn("", "s")
    elif given:
        others = section.table("columns")
        columns = {key: others.text(key) for key in others.values}
        clock = TimeColumn(section.text("column"), section.text("unit", choices=tuple(TIME_UNITS)), columns)
    else:
        raise section.error("'column' is missing; name the time column, or set uniform = true if the log has none.")
    section.finish()
    return clock


def _parse_limits(section: MapSection, joints: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Read joint limits [rad; m]."""
    limits = {}
    for joint in joints:
        if section.has(joint):
            low, high = section.numbers(joint, 2)
            if low >= high:
                raise section.error(f"'{joint}' is {low:g} … {high:g}; the first must be below the second.")
            limits[joint] = (low, high)
    unknown = [joint for joint in section.values if joint not in joints]
    if unknown:
        raise section.error(f"there is no joint '{unknown[0]}'; the joints are: {', '.join(joints)}.")
    return limits


def _parse_thresholds(section: MapSection) -> Thresholds:
    """Read the thresholds of the audits."""
    standard = Thresholds()
    thresholds = Thresholds(
        max_speed=section.positive("max_speed") if section.has("max_speed") else standard.max_speed,
        jitter=section.positive("jitter", standard.jitter),
        allow=section.texts("allow", ()),
    )
    unknown = [name for name in thresholds.allow if name not in ALLOWABLE]
    if unknown:
        raise section.error(f"'allow' names '{unknown[0]}'; only these can be allowed: {', '.join(ALLOWABLE)}.")
    section.finish()
    return thresholds


def _parse_resample(section: MapSection) -> Resample:
    """Read the resampling."""
    resample = Resample(section.positive("rate"), section.text("method", choices=METHODS))
    section.finish()
    return resample


def _parse_task(top: MapSection, constants: Sequence[str], default: str) -> str:
    """Read the task template; braces may only hold `log` and the constants."""
    task = top.text("task", default)
    try:
        fields = [
            f"{field}{':' if spec else ''}{spec}{'!' if conversion else ''}{conversion or ''}"
            for _, field, spec, conversion in string.Formatter().parse(task)
            if field is not None
        ]
    except ValueError:
        raise top.error(f"'task' is '{task}'; its braces do not match.") from None
    unknown = [field for field in fields if field not in {"log", *constants}]
    if unknown:
        choices = ", ".join(["log", *constants])
        raise top.error(f"'task' is '{task}'; braces may hold: {choices}, not '{unknown[0]}'.")
    return task
