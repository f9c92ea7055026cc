"""A dataset in memory: one array per feature over all frames, divided into episodes."""

import operator
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from nas_data.arrays import Array
from nas_data.count_of import count_of
from nas_data.dataset.features import ACTION, EFFORT, NEXT_STATE, POSITION, SIM_STATE, STATE, VELOCITY, Feature
from nas_data.dataset.passthrough import PassthroughFeatures
from nas_data.errors import DatasetInvalid, JointMismatch, OptionError
from nas_data.joint_units import SLIDE

if TYPE_CHECKING:
    import pandas

    from nas_data.dataset.from_arrays import CommandKind, Episodes
    from nas_data.dataset.origin import Origin


def as_read_only(array: Array) -> Array:
    """Return a view of an array through which it cannot be changed; one that is read-only already is returned."""
    if not array.flags.writeable:
        return array
    view = array.view()
    view.flags.writeable = False
    return view


@dataclass(frozen=True, repr=False, eq=False)
class Dataset:
    """Recorded episodes, N frames in all. Its arrays are read-only, because copies share them.

    Compare the content of two datasets with `nas diff`, or with `dataset.content.hash_content`.

    Attributes:
        features: Feature of each column.
        columns: Array of each feature, shape (N, width).
        lengths: Number of frames of each episode, shape (E,).
        fps: Control rate [Hz].
        robot_type: Robot's name as LeRobot stores it.
        tasks: Task of each episode, as a word or sentence; several in an episode are joined in alphabetical order.
        passthrough: Pass-through features such as cameras, texts and matrices; None if there are none.
        origin: Origin of the dataset; None if unknown.
        frame_tasks: Task of each frame, shape (N,), from which `tasks` follow; None if each episode has a single one.
        numbers: Number of each episode in the recording that it was selected from; empty if nothing was selected.
    """

    features: Mapping[str, Feature]
    columns: Mapping[str, Array]
    lengths: Array
    fps: float
    robot_type: str = "unknown"
    tasks: tuple[str, ...] = field(default=())
    passthrough: PassthroughFeatures | None = None
    origin: "Origin | None" = field(default=None, compare=False)
    frame_tasks: Array | None = None
    numbers: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        total = int(self.lengths.sum())
        object.__setattr__(self, "columns", {key: as_read_only(column) for key, column in self.columns.items()})
        for key, feature in self.features.items():
            shape = self.columns[key].shape
            if shape != (total, feature.width):
                raise DatasetInvalid(
                    f"The column '{key}' has shape {shape}; {total} frames of {feature.width} are needed."
                )
        if self.frame_tasks is not None:
            several = self.episode_tasks
            object.__setattr__(self, "tasks", tuple("; ".join(sorted(found)) for found in several))
            if all(len(found) == 1 for found in several):
                object.__setattr__(self, "frame_tasks", None)
        elif not self.tasks:
            object.__setattr__(self, "tasks", ("",) * len(self.lengths))

    def __repr__(self) -> str:
        """Return sizes, rate and joints in a line."""
        seconds = self.n_frames / self.fps
        joints = f"; joints {', '.join(self.joints)}" if STATE in self.features else ""
        sizes = (
            f"{count_of(self.n_episodes, 'episode')}, {count_of(self.n_frames, 'frame')} at {self.fps:g} Hz, "
            f"{seconds:.4g} s"
        )
        return f"Dataset({self.robot_type}: {sizes}{joints}{'; paired' if self.paired else ''})"

    @classmethod
    def load(cls, path: str | Path, episodes: Iterable[int] | None = None) -> "Dataset":
        """Read a dataset of any recorder as transitions in SI units.

        Velocities and next states that LeRobot's recordings lack are derived. Recordings by other tools are audited;
        warnings go to stderr.

        Args:
            path: A version's folder, or `datasets/NAME` for the newest version.
            episodes: Only these episodes, by number, each once; None for all.

        Raises:
            DatasetNotFound: there is no dataset.
            OptionError: no episodes are given, or one twice.
            DatasetInvalid: it is damaged, or not in SI units; names the command that imports it.
            JointMismatch: state and action name different joints.
        """
        from nas_data.dataset.origin import load

        return load(Path(path), episodes)

    @classmethod
    def from_lerobot(cls, folder: str | Path) -> "Dataset":
        """Read a dataset that LeRobot's own tools recorded, in SI units; see `load`.

        One in degrees or −100 … 100 is imported once, on the command line: `nas import FOLDER --map NAME`.
        """
        return cls.load(folder)

    @classmethod
    def from_arrays(
        cls,
        positions: "Episodes",
        commands: "Episodes",
        *,
        rate: float,
        joints: Sequence[str],
        velocities: "Episodes | None" = None,
        times: "Episodes | None" = None,
        kind: "CommandKind | Sequence[CommandKind]" = "position",
        slides: Sequence[str] = (),
        turns: bool = False,
        robot: str = "unknown",
        tasks: Sequence[str] = (),
    ) -> "Dataset":
        """Make a dataset of measured states and commands; the next state is that of the following row.

        Each argument is one episode (T, n), several (E, T, n), or a list of episodes of different lengths. Row t holds
        the state at step t and the command that acts from then on. Positions may have one more row than commands.

        Args:
            positions: Measured positions [rad; slides m].
            commands: Commanded positions [rad; m], velocities [rad/s; m/s] or torques [N·m; N], by `kind`.
            rate: Control rate [Hz].
            joints: Names of the n joints.
            velocities: Measured velocities [rad/s; m/s]; derived from the positions if None.
            times: Recorder's clock [s], shape (T,) per episode; rows are evenly spaced if None.
            kind: Type of the commands: `position`, `velocity` or `torque`; or a list with the type at each joint.
            slides: Names of the slide joints.
            turns: Whether joints may exceed two turns; otherwise such positions are refused as degrees.
            robot: Name of the robot.
            tasks: Task of each episode; empty by default.

        Raises:
            DatasetInvalid: shapes differ, or values cannot be right: degrees, NaN, a clock that goes back.
            JointMismatch: a joint is named twice, or a slide is no joint.
            OptionError: the rate or a kind is invalid.
        """
        from nas_data.dataset.from_arrays import make_from_arrays

        return make_from_arrays(positions, commands, rate, joints, velocities, times, kind, slides, turns, robot, tasks)

    def save(self, path: str | Path) -> Path:
        """Write the dataset as the next version of a name; a recorded version is never changed.

        Args:
            path: `datasets/NAME`, a folder of versions, which need not exist; or one of its versions.

        Returns:
            The version's folder; an earlier one where that has the same content and source.

        Raises:
            OptionError: the name is no folder's name.
            DatasetInvalid: LeRobot's tools could not read it.
        """
        from nas_data.dataset.origin import save

        return save(self, Path(path))

    def to_pandas(self) -> "pandas.DataFrame":
        """Return a table: a row for each frame by (episode, frame), a column for each (feature, component).

        `table["observation.state", "m1.pos"]` is the measured position [rad] of the joint m1.
        """
        from nas_data.dataset.origin import as_frame

        return as_frame(self)

    @property
    def n_frames(self) -> int:
        """Number of frames in all episodes."""
        return int(self.lengths.sum())

    @property
    def n_episodes(self) -> int:
        """Number of episodes."""
        return len(self.lengths)

    @cached_property
    def starts(self) -> Array:
        """First frame of each episode, shape (E,)."""
        return np.concatenate([[0], np.cumsum(self.lengths)[:-1]]).astype(np.int64)

    @property
    def episode_numbers(self) -> tuple[int, ...]:
        """Number of each episode for messages: that in the recording from which it was selected."""
        return self.numbers or tuple(range(self.n_episodes))

    @property
    def episode_tasks(self) -> list[list[str]]:
        """Tasks of each episode in the order in which they appear; one where an episode has a single task."""
        if self.frame_tasks is None:
            return [[task] for task in self.tasks]
        return [list(dict.fromkeys(self.frame_tasks[frames].tolist())) for frames in self.episodes()]

    @property
    def all_tasks(self) -> list[str]:
        """Each task once, in the order in which they appear."""
        return list(dict.fromkeys(task for found in self.episode_tasks for task in found))

    @property
    def task_of_frame(self) -> Array:
        """Task of each frame, shape (N,)."""
        if self.frame_tasks is not None:
            return self.frame_tasks
        return np.repeat(np.array(self.tasks, object), self.lengths)

    @cached_property
    def joints(self) -> tuple[str, ...]:
        """Names of the measured joints, from the position components of `observation.state`."""
        names = self._find_feature(STATE).names
        return tuple(name.removesuffix(POSITION) for name in names if name.endswith(POSITION))

    @cached_property
    def slides(self) -> frozenset[str]:
        """Names of the joints that are slides: those whose positions are in metres."""
        feature = self._find_feature(STATE)
        pairs = zip(feature.names, feature.units, strict=False)  # without units, all are taken for hinges
        return frozenset(
            name.removesuffix(POSITION) for name, unit in pairs if name.endswith(POSITION) and unit == SLIDE.si
        )

    @property
    def kinds(self) -> tuple[str, ...]:
        """Command type of each joint: position (`.pos`), velocity (`.vel`) or torque (`.effort`)."""
        ends = VELOCITY, EFFORT
        return tuple(next((e for e in ends if name.endswith(e)), POSITION) for name in self._find_feature(ACTION).names)

    @property
    def commands_positions(self) -> bool:
        """Whether every joint is commanded positions."""
        return bool(self.positional.all())

    @property
    def positional(self) -> Array:
        """Which joints are commanded positions, shape (n,)."""
        return np.array([kind == POSITION for kind in self.kinds], bool)

    @property
    def paired(self) -> bool:
        """Whether the source's prediction for each transition is present."""
        return SIM_STATE in self.features

    @property
    def states(self) -> Array:
        """Measured positions [rad] then velocities [rad/s], shape (N, 2n)."""
        return self._column(STATE)

    @property
    def commands(self) -> Array:
        """Commands [rad; rad/s; N·m; slides in m and N], shape (N, n); see `kinds`."""
        return self._column(ACTION)

    @property
    def next_states(self) -> Array:
        """Measured states of the next control step, shape (N, 2n)."""
        return self._column(NEXT_STATE)

    @property
    def sim_states(self) -> Array:
        """Predicted states of the next control step by the source, shape (N, 2n)."""
        return self._column(SIM_STATE)

    def episode(self, index: int) -> slice:
        """Return the frames of one episode."""
        start = int(self.starts[index])
        return slice(start, start + int(self.lengths[index]))

    def episodes(self) -> Iterator[slice]:
        """Iterate over the frames of each episode."""
        return (self.episode(index) for index in range(self.n_episodes))

    def select(self, episodes: Iterable[int]) -> "Dataset":
        """Return a dataset of the given episodes, in the given order; an episode may be given more than once.

        Raises:
            OptionError: no episodes are given.
            DatasetInvalid: there is no such episode.
        """
        chosen = read_episode_numbers(episodes)
        beyond = [index for index in chosen if not 0 <= index < self.n_episodes]
        if beyond:
            raise DatasetInvalid(f"There is no episode {beyond[0]}; the dataset has 0 to {self.n_episodes - 1}.")
        rows = np.concatenate([np.arange(self.n_frames)[self.episode(index)] for index in chosen])
        taken = self.take(rows, self.lengths[chosen], tuple(self.tasks[index] for index in chosen))
        numbers = tuple(self.episode_numbers[index] for index in chosen)
        return replace(taken, numbers=numbers, origin=self.origin and self.origin.select(chosen))

    def select_each_once(self, episodes: Iterable[int] | None) -> "Dataset":
        """Return a dataset of the given episodes; all for None.

        Raises:
            OptionError: no episodes are given, or one twice.
            DatasetInvalid: there is no such episode.
        """
        if episodes is None:
            return self
        chosen = read_episode_numbers(episodes)
        repeated = [episode for place, episode in enumerate(chosen) if episode in chosen[:place]]
        if repeated:
            raise OptionError(f"Episode {repeated[0]} is given twice; give each episode once.")
        return self.select(chosen)

    def take(self, rows: Array, lengths: Array, tasks: Sequence[str]) -> "Dataset":
        """Return a dataset of the given frames.

        Args:
            rows: Frame numbers in their new order.
            lengths: Number of frames of each new episode, shape (E,).
            tasks: Task of each new episode.
        """
        return replace(
            self,
            columns={key: column[rows] for key, column in self.columns.items()},
            lengths=lengths,
            tasks=tuple(tasks),
            numbers=(),
            passthrough=self.passthrough and self.passthrough.take(rows),
            frame_tasks=None if self.frame_tasks is None else self.frame_tasks[rows],
        )

    def with_column(self, key: str, feature: Feature, column: Array) -> "Dataset":
        """Return the dataset with one more (or a replaced) column of shape (N, width)."""
        return replace(self, features={**self.features, key: feature}, columns={**self.columns, key: column})

    def without_columns(self, keys: Collection[str]) -> "Dataset":
        """Return the dataset without some columns; keys that it lacks are ignored."""
        kept = [key for key in self.features if key not in keys]
        return replace(
            self,
            features={key: self.features[key] for key in kept},
            columns={key: self.columns[key] for key in kept},
        )

    def _find_feature(self, key: str) -> Feature:
        if key not in self.features:
            raise JointMismatch(f"The dataset has no feature '{key}'; it has: {', '.join(self.features)}.")
        return self.features[key]

    def _column(self, key: str) -> Array:
        self._find_feature(key)
        return self.columns[key]


def read_episode_numbers(episodes: Iterable[int]) -> list[int]:
    """Return the numbers of episodes as a list; NumPy's integers are numbers, too.

    Raises:
        OptionError: there are none, or they are no whole numbers.
    """
    try:
        chosen = [operator.index(episode) for episode in episodes]
    except TypeError:
        raise OptionError(f"The episodes are {episodes!r}; give their numbers, such as [0, 2].") from None
    if not chosen:
        raise OptionError("No episodes are given; give their numbers, such as [0, 2].")
    return chosen
