"""The map: where in a log each quantity stands and what its numbers mean."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from nas_data.dataset.timing import LATE
from nas_data.importing.conversion import Conversion
from nas_data.importing.layout import LogLayout

ALIGNMENTS = ("action_follows_state", "state_follows_action")


@dataclass(frozen=True)
class LogColumns:
    """Where in a log some numbers stand.

    Attributes:
        columns: One column (array, key) that holds a vector, or one column a joint.
        table: Which of the log's files, by its key in `[files]`; empty where a log is one file.
        components: Which components of a vector column, in joint order; empty for all.
        constant: The log holds them once, not in every row.
        names: What the components are called in the log, in joint order; empty where they are called as the joints.
    """

    columns: tuple[str, ...]
    table: str = ""
    components: tuple[int, ...] = ()
    constant: bool = False
    names: tuple[str, ...] = ()


@dataclass(frozen=True)
class LogQuantity:
    """A quantity of the log.

    Attributes:
        name: What it is called: position, velocity, command or the signal's name.
        unit: Unit after conversion.
        source: Where it stands.
        conversion: How it becomes SI, one line a joint.
        encoding: How a raw register holds its sign; empty for plain numbers.
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
        column: Empty where the log has no time: its rows are said to be one period apart.
        unit: A key of `conversion.TIME_UNITS`.
        columns: Columns of those tables that have another one.
    """

    column: str
    unit: str
    columns: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class ServoTicks:
    """What LeRobot's units mean in ticks of a servo.

    Attributes:
        resolution: Ticks a turn.
        drive_mode: Whether LeRobot turns −100 … 100 round where a calibration says drive_mode 1.
    """

    resolution: int
    drive_mode: bool


@dataclass(frozen=True)
class Thresholds:
    """What the audits compare with.

    Attributes:
        max_speed: Speed that no joint can have [rad/s; m/s]; None for what no usual joint can have.
        jitter: Largest deviation of a time step, as a share of the period.
        allow: Checks whose errors become warnings, because the user knows better.
    """

    max_speed: float | None = None
    jitter: float = LATE
    allow: tuple[str, ...] = ()


@dataclass(frozen=True)
class Resample:
    """Even spacing in time.

    Attributes:
        rate: Rows a second afterwards [Hz].
        method: How positions and velocities between two rows are found: `linear` or `previous`.
    """

    rate: float
    method: str


@dataclass(frozen=True)
class Map:
    """Everything that turns a log into episodes.

    Attributes:
        name: Map's name, for reports.
        text: The file as it was read; it is kept with the dataset.
        layout: How a log lies on disk.
        robot: Robot's name.
        joints: Joint names in the order of the log's vectors.
        rate: Control rate of the log [Hz]; 0 where each log says its own.
        alignment: `action_follows_state`: a row's command acts after its state was measured;
            `state_follows_action`: a row's state is the answer to its command.
        derive_velocity: Whether velocities are derived from positions rather than read.
        clock: Where the time stands.
        position: Measured positions [rad].
        velocity: Measured velocities [rad/s]; None where the log has none.
        command: Commanded positions [rad], velocities [rad/s] or torques [N·m].
        signals: What else is kept, as `nas.<name>`.
        episode: Column that tells the episodes of one log apart; None where a log is one episode.
        slides: Joints that are slides: in metres and newtons, where others are in radians and newton metres.
        limits: Limits [rad; m] by joint; joints without limits are absent.
        thresholds: What the audits compare with.
        resample: Even spacing in time; None where rows stay as recorded.
        constants: Keys of the log that go to provenance.
        task: What an episode does; `{log}` and the constants are filled in.
        joint_names: Array of the log that holds its joint names, once or in every row; may be empty.
        servo: The servos behind units of LeRobot; None where the map says nothing of them.
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

    @property
    def commands_positions(self) -> bool:
        """Whether every joint is commanded positions."""
        return set(self.command.conversion.kinds) == {"position"}

    @property
    def fps(self) -> float:
        """Control rate of the dataset [Hz]."""
        return self.resample.rate if self.resample else self.rate
