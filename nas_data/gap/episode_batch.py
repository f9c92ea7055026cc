"""Measured episodes as arrays: initial positions, commands, and the positions that followed."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from nas_data.arrays import thin_evenly
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.start_velocities import find_start_velocities, fit_velocity
from nas_data.errors import DatasetInvalid
from nas_data.gap.finding.torque_off import count_rows_with_torque
from nas_data.gap.gains import read_relative_gains
from nas_data.pairing import read_object_states
from nas_data.simulators.base import Simulator
from nas_data.simulators.initial_states import InitialLoad

DELAY_SECONDS = 0.5  # [s] of commands before a window that fill its delays
CONSTANT_TOLERANCE = 1e-6  # [rad or N·m] within which a command is constant
MIN_ROWS = 10  # fewest control steps of an episode
WINDOW = 5.0  # [s] length of windows; errors of a position-controlled arm do not grow with time
MAX_UNCUT = 1.5  # window lengths up to which an episode is not cut
STILL_SECONDS = 0.5  # [s] around an even spacing in which a window starts at the slowest row
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


def cut_windows(evidence: EpisodeBatch, rows: int, seconds: float = WINDOW) -> EpisodeBatch:
    """Return windows of a given length, evenly over the recording, with `rows` rows in total.

    Windows do not overlap by more than rounding, because overlapping data would appear more certain. Each episode gives
    at least one window. Episodes stay whole if none is much longer than a window.

    Args:
        evidence: Episodes.
        rows: Largest number of rows in total; at least two windows are returned if possible.
        seconds: Length of a window [s].
    """
    longest, steps = evidence.commands.shape[1], round(seconds / evidence.period)
    if longest <= MAX_UNCUT * steps:
        return evidence.select(thin_evenly(len(evidence), rows // longest))
    places = [place for number in range(len(evidence)) for place in find_windows(evidence, number, steps)]
    chosen = [places[index] for index in thin_evenly(len(places), rows // steps)]
    return join_episodes([cut_window(evidence, number, first, steps) for number, first in chosen])


def find_windows(evidence: EpisodeBatch, number: int, steps: int) -> list[tuple[int, int]]:
    """Return the episode's number and first row of each window of an episode."""
    last = max(0, int(evidence.mask[number].sum()) - steps)
    count = max(1, round((last + steps) / steps))
    offsets = np.linspace(0, last, count).round().astype(int)
    return [(number, find_stillest_row(evidence, number, int(offset), last)) for offset in offsets]


def find_stillest_row(evidence: EpisodeBatch, episode: int, offset: int, last: int) -> int:
    """Return the row near an offset at which the joints move least."""
    reach = round(STILL_SECONDS / evidence.period)
    low, high = max(0, offset - reach), min(last, offset + reach)
    if low == 0:
        return 0  # an episode's own start is at rest
    speeds = np.abs(compute_velocities(evidence, episode)).max(1)
    return low + int(speeds[low : high + 1].argmin())


def compute_velocities(evidence: EpisodeBatch, episode: int) -> np.ndarray:
    """Return an episode's velocities by central differences over 100 ms [rad/s; m/s], shape (T, n)."""
    reach = max(1, round(0.05 / evidence.period))
    rows = evidence.measured[episode]
    padded = np.concatenate([np.repeat(rows[:1], reach, 0), rows, np.repeat(rows[-1:], reach, 0)])
    return np.asarray((padded[2 * reach :] - padded[: -2 * reach]) / (2 * reach * evidence.period))


def estimate_velocity(evidence: EpisodeBatch, episode: int, row: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the velocities before a row and their standard deviations [rad/s; m/s], shape (n,) each."""
    if row == 0:
        return evidence.initial_velocities[episode], evidence.velocity_deviations[episode]
    length, rate = int(evidence.mask[episode].sum()), 1 / evidence.period
    positions = np.concatenate([evidence.initial_positions[episode][None], evidence.measured[episode, :length]])
    fitted = [
        fit_velocity(positions[:, joint], row, float(evidence.noise[joint]), rate)
        for joint in range(len(evidence.joints))
    ]
    values, deviations = np.array(fitted).T
    measured = evidence.measured_velocities[episode, row - 1]
    is_measured = np.isfinite(measured)
    return np.where(is_measured, measured, values), deviations


def cut_window(evidence: EpisodeBatch, episode: int, first: int, steps: int) -> EpisodeBatch:
    """Return a window of one episode."""
    rows = slice(first, first + steps)
    part = evidence.select([episode])
    start = part.initial_positions if first == 0 else part.measured[:, first - 1]
    speed, deviation = (values[None] for values in estimate_velocity(evidence, episode, first))
    return replace(
        part,
        initial_positions=start,
        estimated_positions=start,
        commands=part.commands[:, rows],
        measured=part.measured[:, rows],
        mask=part.mask[:, rows],
        initial_velocities=speed,
        estimated_velocities=speed,
        velocity_deviations=deviation,
        measured_velocities=part.measured_velocities[:, rows],
        torque_off_from=np.clip(part.torque_off_from - first, 0, steps),
        objects=part.objects[:, rows],
        earlier_commands=select_earlier_commands(part, first),
        first_rows=part.first_rows + first,
    )


def select_earlier_commands(episode: EpisodeBatch, row: int) -> np.ndarray:
    """Return the commands before a row of one episode, shape (1, L, n); NaN before its first row."""
    count = max(1, round(DELAY_SECONDS / episode.period))
    known = episode.commands[:, max(0, row - count) : row]
    if not row:
        return np.full((1, count, known.shape[2]), np.nan)
    return np.concatenate([np.repeat(known[:, :1], count - known.shape[1], axis=1), known], axis=1)


def pad_episodes(evidence: EpisodeBatch, rows: int) -> EpisodeBatch:
    """Return the episodes with at least `rows` rows; added ones repeat the last and count as not recorded."""
    more = max(0, rows - evidence.commands.shape[1])

    def pad(values: np.ndarray) -> np.ndarray:
        return np.concatenate([values, np.repeat(values[:, -1:], more, axis=1)], axis=1)

    return replace(
        evidence,
        commands=pad(evidence.commands),
        measured=pad(evidence.measured),
        mask=np.concatenate([evidence.mask, np.zeros((len(evidence), more), bool)], axis=1),
        measured_velocities=pad(evidence.measured_velocities),
        objects=pad(evidence.objects),
    )


def join_episodes(parts: Sequence[EpisodeBatch]) -> EpisodeBatch:
    """Concatenate batches with equal numbers of rows."""
    return replace(parts[0], **{name: np.concatenate([getattr(part, name) for part in parts]) for name in PARTS})
