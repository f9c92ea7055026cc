"""The map: source, unit and meaning of each quantity in a log."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from nas_data.dataset.audits.base import Remedies
from nas_data.dataset.timing import LATE
from nas_data.importing.conversion import Conversion
from nas_data.importing.layout import LogLayout

ALIGNMENTS = ("action_follows_state", "state_follows_action")
KEPT_VELOCITY = "velocity"  # signal that keeps the measured velocities when the state has derived ones


@dataclass(frozen=True)
class LogColumns:
    """Columns of a quantity in a log.

    Attributes:
        columns: One column (array, key) with a vector, or one column per joint.
        table: File or topic, by its key in `[files]` or `[topics]`; empty if a log is one file.
        components: Components of a vector column, in joint order; empty for all.
        constant: Whether the log holds the values once instead of in every row.
        names: Names of the components in the log, in joint order; empty if they are the joint names.
        tables: File or topic of each joint, if each has its own; else empty.
    """

    columns: tuple[str, ...]
    table: str = ""
    components: tuple[int, ...] = ()
    constant: bool = False
    names: tuple[str, ...] = ()
    tables: tuple[str, ...] = ()

    @property
    def parts(self) -> "tuple[LogColumns, ...]":
        """The columns of each joint if each has a table of its own; else the columns themselves."""
        if not self.tables:
            return (self,)
        return tuple(
            LogColumns((column,), table, names=self.names[index : index + 1])
            for index, (column, table) in enumerate(zip(self.columns, self.tables, strict=True))
        )


@dataclass(frozen=True)
class LogQuantity:
    """A quantity of the log.

    Attributes:
        name: position, velocity, command or the signal's name.
        unit: Unit after conversion.
        source: Its columns in the log.
        conversion: Conversion to SI of each component.
        encoding: Sign encoding of a raw register; empty for plain numbers.
    """

    name: str
    unit: str
    source: LogColumns
    conversion: Conversion
    encoding: str = ""


@dataclass(frozen=True)
class TimeColumn:
    """Column and unit of the time.

    Attributes:
        column: Name of the column; empty if the log has no time and its rows are evenly spaced.
        unit: A key of `conversion.TIME_UNITS`.
        columns: Column names of tables that use another name.
    """

    column: str
    unit: str
    columns: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class ServoTicks:
    """Servo properties behind LeRobot's units.

    Attributes:
        resolution: Ticks per turn.
        drive_mode: Whether LeRobot reverses −100 … 100 if the calibration has drive_mode 1.
    """

    resolution: int
    drive_mode: bool


@dataclass(frozen=True)
class Thresholds:
    """Thresholds of the audits.

    Attributes:
        max_speed: Speed that no joint can reach [rad/s; m/s]; None for a default.
        jitter: Largest deviation of a time step, as a share of the period.
        allow: Checks whose errors the user turned into warnings.
    """

    max_speed: float | None = None
    jitter: float = LATE
    allow: tuple[str, ...] = ()


@dataclass(frozen=True)
class Resample:
    """Resampling to even time steps.

    Attributes:
        rate: New rate [Hz].
        method: Interpolation of positions and velocities: `linear` or `previous`.
    """

    rate: float
    method: str


@dataclass(frozen=True)
class Map:
    """Complete description of the conversion of a log into episodes.

    Attributes:
        name: Name of the map, for reports.
        text: Content of the map file; it is stored with the dataset.
        layout: Layout of a log on disk.
        robot: Robot's name.
        joints: Joint names in the order of the log's vectors.
        rate: Control rate of the log [Hz]; 0 if each log gives its own.
        alignment: `action_follows_state`: a row's command acts after its state was measured; `state_follows_action`: a
            row's state is the response to its command.
        derive_velocity: Whether velocities are derived from positions rather than read.
        clock: Source of the time.
        position: Measured positions [rad].
        velocity: Measured velocities [rad/s]; None if the log has none.
        command: Commanded positions [rad], velocities [rad/s] or torques [N·m].
        signals: Other quantities, stored as `nas.<name>`.
        episode: Column with the episode of each row; None if a log is one episode.
        slides: Names of the slide joints, in metres and newtons instead of radians and newton metres.
        limits: Limits [rad; m] by joint; joints without limits are absent.
        thresholds: Thresholds of the audits.
        resample: Resampling; None to keep the rows as recorded.
        constants: Keys of the log that go to provenance.
        task: Task of an episode; `{log}` and the constants are filled in.
        joint_names: Array of the log that holds its joint names, once or in every row; empty for a message's own field.
        servo: Servo properties behind LeRobot's units; None if the map gives none.
        remedies: Remedies for findings of the audits if this is no map file; None for the map's keys.
    """

    name: str
    text: str
    layout: LogLayout
    robot: str
    joints: tuple[str, ...]
    rate: float
    alignment: str
    derive_velocity: bool
    clock: TimeColumn
    position: LogQuantity
    velocity: LogQuantity | None
    command: LogQuantity
    signals: Mapping[str, LogQuantity]
    episode: LogColumns | None
    slides: frozenset[str]
    limits: Mapping[str, tuple[float, float]]
    thresholds: Thresholds
    resample: Resample | None
    constants: tuple[str, ...]
    task: str
    joint_names: str
    servo: ServoTicks | None = None
    remedies: Remedies | None = None

    @property
    def fps(self) -> float:
        """Control rate of the dataset [Hz]."""
        return self.resample.rate if self.resample else self.rate

    @property
    def quantities(self) -> tuple[LogQuantity, ...]:
        """All quantities that are read."""
        return tuple(filter(None, (self.position, self.velocity, self.command, *self.signals.values())))

    def find_parts(self, table: str) -> list[LogColumns]:
        """Return what is read from a file or topic."""
        return [part for quantity in self.quantities for part in quantity.source.parts if part.table == table]
