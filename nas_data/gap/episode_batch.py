"""Measured episodes as arrays: initial positions, commands, and the positions that followed."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.start_velocities import find_start_velocities
from nas_data.dataset.torque_off import count_rows_with_torque
from nas_data.errors import DatasetInvalid
from nas_data.gap.gains import read_relative_gains
from nas_data.pairing import read_object_states
from nas_data.simulators.base import Simulator
from nas_data.simulators.initial_states import InitialLoad

CONSTANT_TOLERANCE = 1e-6  # [rad or N·m] within which a command is constant
MIN_ROWS = 10  # fewest control steps of an episode
# fields with one entry for each episode
PARTS = (
    "initial_positions", "commands", "measured", "mask", "numbers", "initial_velocities", "estimated_positions",
    "estimated_velocities", "velocity_deviations", "measured_velocities", "initial_loads", "gains", "torque_off_from",
    "objects", "earlier_commands", "first_rows",
)  # fmt: skip


@dataclass(frozen=True)
class EpisodeBatch:
    """E episodes of up to T control steps of n joints.

    Attributes:
        joints: Names of the measured joints.
        period: Control period [s].
        initial_positions: Positions at the start of a rollout [rad; m], shape (E, n).
        commands: Commands, shape (E, T, n); the last one is repeated after the end of a shorter episode.
        measured: Positions after each command [rad; m], shape (E, T, n).
        mask: Whether a row was recorded, shape (E, T).
        numbers: Numbers of the episodes in the dataset, shape (E,).
        initial_velocities: Velocities at the start of a rollout [rad/s; m/s], shape (E, n); 0 for a start at rest.
        estimated_positions: First measured positions [rad; m], shape (E, n).
        estimated_velocities: Estimated initial velocities [rad/s; m/s], shape (E, n).
        velocity_deviations: Standard deviations of `estimated_velocities` [rad/s; m/s], shape (E, n); 0 for a start at
            rest. Where they are not 0, a fit may move the initial state within the uncertainty of its estimates.
        measured_velocities: Velocities after each command [rad/s; m/s], shape (E, T, n); NaN if not measured.
        noise: Standard deviation of the position readings [rad; m], shape (n,).
        initial_loads: Assumed `InitialLoad` of each joint, which is not measured, shape (E, n).
        gains: Position gain of each servo relative to the model's, shape (E, n).
        torque_off_from: Row from which the servos are switched off, shape (E,); T if they stay on.
        earlier_commands: Commands of the L control periods before the first row, shape (E, L, n); NaN if not known.
        objects: Measured states of the model's objects before each command, shape (E, T, m); m is 0 without objects.
        first_rows: Row of the recorded episode at which each begins, shape (E,).
    """

    joints: tuple[str, ...]
    period: float
    initial_positions: np.ndarray
    commands: np.ndarray
    measured: np.ndarray
    mask: np.ndarray
    numbers: np.ndarray
    initial_velocities: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))
    estimated_positions: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))
    estimated_velocities: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))
    velocity_deviations: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))
    measured_velocities: np.ndarray = field(default_factory=lambda: np.empty((0, 0, 0)))
    noise: np.ndarray = field(default_factory=lambda: np.empty(0))
    initial_loads: np.ndarray = field(default_factory=lambda: np.empty((0, 0), int))
    gains: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))
    torque_off_from: np.ndarray = field(default_factory=lambda: np.empty(0, int))
    objects: np.ndarray = field(default_factory=lambda: np.empty((0, 0, 0)))
    earlier_commands: np.ndarray = field(default_factory=lambda: np.empty((0, 0, 0)))
    first_rows: np.ndarray = field(default_factory=lambda: np.empty(0, int))

    def __post_init__(self) -> None:
        first, commands = self.initial_positions, self.commands
        self._set_default("initial_velocities", np.zeros_like(first, dtype=float))
        self._set_default("estimated_positions", first)
        self._set_default("estimated_velocities", self.initial_velocities)
        self._set_default("velocity_deviations", np.zeros_like(self.initial_velocities))
        self._set_default("measured_velocities", np.full(commands.shape, np.nan))
        self._set_default("noise", np.zeros(len(self.joints)))
        self._set_default("initial_loads", np.full(first.shape, InitialLoad.GRAVITY))
        self._set_default("gains", np.ones(first.shape))
        self._set_default("torque_off_from", np.full(len(first), commands.shape[1]))
        self._set_default("earlier_commands", np.full((len(first), 0, first.shape[1]), np.nan))
        self._set_default("objects", np.empty((*commands.shape[:2], 0)))
        self._set_default("first_rows", np.zeros(len(first), int))

    def _set_default(self, name: str, value: np.ndarray) -> None:
        """Set a field that was not given."""
        if not getattr(self, name).size:
            object.__setattr__(self, name, value)

    @classmethod
    def of(cls, dataset: Dataset) -> "EpisodeBatch":
        """Read a dataset's episodes, with their gains and the rows with the torque on.

        Raises:
            DatasetInvalid: no episode is long enough.
        """
        n = len(dataset.joints)
        chosen = [index for index in range(dataset.n_episodes) if dataset.lengths[index] >= MIN_ROWS]
        if not chosen:
            raise DatasetInvalid(
                f"No episode has {MIN_ROWS} frames; a gap cannot be named from isolated transitions: record episodes."
            )
        rows = [dataset.episode(index) for index in chosen]
        longest = max(part.stop - part.start for part in rows)
        driven, lengths = count_rows_with_torque(dataset)[chosen], dataset.lengths[chosen]
        starts = find_start_velocities(dataset)
        rates = np.stack([pad_rows(dataset.next_states[part, n:], longest) for part in rows])
        return cls(
            joints=dataset.joints,
            period=1 / dataset.fps,
            initial_positions=np.stack([dataset.states[part.start, :n] for part in rows]).astype(float),
            commands=np.stack([pad_rows(dataset.commands[part], longest) for part in rows]),
            measured=np.stack([pad_rows(dataset.next_states[part, :n], longest) for part in rows]),
            mask=np.stack([np.arange(longest) < part.stop - part.start for part in rows]),
            numbers=np.array(chosen),
            initial_velocities=starts.values[chosen],
            velocity_deviations=starts.deviations[chosen],
            measured_velocities=np.where(starts.derived, np.nan, rates),
            noise=starts.noise,
            gains=read_relative_gains(dataset)[chosen],
            torque_off_from=np.where(driven < lengths, driven, longest),
        )

    def __len__(self) -> int:
        return len(self.initial_positions)

    @property
    def begins_in_motion(self) -> bool:
        """Whether an episode begins in motion, so that its initial state is uncertain."""
        return bool((self.start_deviations > 0).any())

    @property
    def start_deviations(self) -> np.ndarray:
        """Standard deviations of initial positions, then velocities [rad, rad/s; m, m/s], shape (E, 2n).

        They are 0 for a joint that starts at rest.
        """
        moves = self.velocity_deviations > 0
        return np.concatenate([moves * self.noise, self.velocity_deviations], axis=1)

    @property
    def start_changes(self) -> np.ndarray:
        """Initial positions, then velocities, minus their estimates [rad, rad/s; m, m/s], shape (E, 2n)."""
        positions = self.initial_positions - self.estimated_positions
        return np.concatenate([positions, self.initial_velocities - self.estimated_velocities], axis=1)

    def with_start_changes(self, changes: np.ndarray | float) -> "EpisodeBatch":
        """Return the episodes with other `start_changes`."""
        n = len(self.joints)
        changes = np.broadcast_to(changes, (len(self), 2 * n))
        return replace(
            self,
            initial_positions=self.estimated_positions + changes[:, :n],
            initial_velocities=self.estimated_velocities + changes[:, n:],
        )

    @property
    def initial(self) -> np.ndarray:
        """Initial states: positions [rad; m], velocities [rad/s; m/s], then objects, shape (E, 2n + m)."""
        return np.concatenate([self.initial_positions, self.initial_velocities, self.objects[:, 0]], axis=1)

    def with_objects(self, dataset: Dataset, simulator: Simulator) -> "EpisodeBatch":
        """Return the episodes with the measured states of a model's objects.

        Args:
            dataset: Transitions of the episodes.
            simulator: Model; objects that the dataset lacks start in their reference posture.
        """
        states = read_object_states(dataset, simulator)
        rows = [dataset.episode(int(number)) for number in self.numbers]
        return replace(self, objects=np.stack([pad_rows(states[part], self.commands.shape[1]) for part in rows]))

    def with_initial_loads(self, holds: np.ndarray | InitialLoad) -> "EpisodeBatch":
        """Return the episodes with assumed initial loads, one for all or shape (E, n)."""
        return replace(self, initial_loads=np.broadcast_to(np.asarray(holds), self.initial_positions.shape))

    def select(self, episodes: Sequence[int] | np.ndarray) -> "EpisodeBatch":
        """Return some of the episodes, by index."""
        chosen = list(episodes)
        return replace(self, **{name: getattr(self, name)[chosen] for name in PARTS})

    def first(self, rows: int) -> "EpisodeBatch":
        """Return the first rows of every episode."""
        early = slice(0, rows)
        return replace(
            self,
            commands=self.commands[:, early],
            measured=self.measured[:, early],
            mask=self.mask[:, early],
            measured_velocities=self.measured_velocities[:, early],
            torque_off_from=np.minimum(self.torque_off_from, rows),
            objects=self.objects[:, early],
        )

    @property
    def motions(self) -> np.ndarray:
        """Standard deviation of each joint's measured positions in each episode [rad; m], shape (E, n)."""
        counted = self.mask[..., None]
        means = np.mean(self.measured, axis=1, where=counted, keepdims=True)
        return np.asarray(np.sqrt(np.mean((self.measured - means) ** 2, axis=1, where=counted)))

    def find_constant_commands(self) -> np.ndarray:
        """Return a mask of the joints whose command is the same in all rows of all episodes, shape (n,)."""
        return np.asarray(np.ptp(self.commands[self.mask], axis=0) <= CONSTANT_TOLERANCE)

    def errors(self, predicted: np.ndarray) -> np.ndarray:
        """Return predicted minus measured positions [rad; m], shape (E, T, n); 0 after an episode's end."""
        return np.where(self.mask[..., None], predicted - self.measured, 0.0)

    def mean_squares(self, predicted: np.ndarray) -> np.ndarray:
        """Return the mean squared error of each episode and joint [rad²; m²], shape (E, n)."""
        return np.asarray((self.errors(predicted) ** 2).sum(1) / self.mask.sum(1)[:, None])


def pad_rows(rows: np.ndarray, steps: int) -> np.ndarray:
    """Return rows as float64, with the last one repeated up to a number of rows."""
    return np.concatenate([rows, np.repeat(rows[-1:], steps - len(rows), axis=0)]).astype(float)


def split_episodes(evidence: EpisodeBatch, share: float = 1 / 3) -> tuple[EpisodeBatch, EpisodeBatch]:
    """Split episodes into fitted and held-out ones, evenly over the recording.

    Args:
        evidence: At least two episodes.
        share: Share of held-out episodes.
    """
    count = len(evidence)
    held = max(1, round(share * count))
    places = np.unique(np.floor((np.arange(held) + 0.5) * count / held).astype(int))
    rest = np.setdiff1d(np.arange(count), places)
    return evidence.select(rest), evidence.select(places)
