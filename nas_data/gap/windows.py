"""Windows: parts of measured episodes, from which rollouts begin, too."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from nas_data.arrays import thin_evenly
from nas_data.count_of import count_of
from nas_data.dataset.start_velocities import fit_velocity
from nas_data.gap.episode_batch import PARTS, EpisodeBatch

DELAY_SECONDS = 0.5  # [s] of commands before a window that fill its delays
WINDOW = 5.0  # [s] length of windows; errors of a position-controlled arm do not grow with time
MAX_UNCUT = 1.5  # window lengths up to which an episode is not cut
STILL_SECONDS = 0.5  # [s] around an even spacing in which a window starts at the slowest row


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


def describe_windows(numbers: Sequence[int] | np.ndarray, adjective: str = "") -> str:
    """Return the number of episodes as words, and into how many windows they are cut if they are.

    Args:
        numbers: Number of the episode of each window.
        adjective: Word before `episode`.
    """
    count = len(np.unique(numbers))
    episodes = count_of(count, f"{adjective} episode".lstrip())
    return episodes if count == len(numbers) else f"{episodes}, in {count_of(len(numbers), 'window')}"


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
