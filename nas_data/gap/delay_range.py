"""Delays that differ from episode to episode, told from delays that do not."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from nas_data.arrays import thin_evenly
from nas_data.effects.base import Effect
from nas_data.errors import ModelFileError
from nas_data.gap.search.constants import PARAMETER_PRICE
from nas_data.gap.search.intervals import number_recordings
from nas_data.gap.search.objective import FitTask

RATIO = 1.15  # between neighbouring delays that are tried
MOST = 8  # neighbours on either side: a third to three times the delay
MOST_EPISODES = 40  # episodes, or windows of long ones, that are compared


def find_delay_range(
    task: FitTask, effects: Sequence[Effect], factors: dict[str, float], number: int
) -> Mapping[str, tuple[float, float]]:
    """Return the smallest and the largest delay [s] of single episodes, by parameter; empty if they do not differ.

    Each episode is predicted with several delays, everything else unchanged. An episode has a delay of its own if this
    lowers its misfit by more than the price of a parameter. If fewer than four episodes were recorded, windows of 5 s
    are compared, so that a delay that changes within an episode is found, too.

    Args:
        task: Model and training episodes.
        effects: All fitted effects.
        factors: Fitted factors of the model's parameters, by name.
        number: Index of the effect.
    """
    effect = effects[number]
    task = task.select(thin_evenly(len(task.evidence), MOST_EPISODES))
    recordings = number_recordings(task.evidence)
    if not effect.stepwise or recordings.max() < 1:
        return {}
    task = task.infer_initial_loads(effects, factors).estimate_initial_states(effects, factors)
    task = task.correct_timestep(effects, factors)
    (name,) = effect.stepwise
    bounds = next(parameter for parameter in effect.parameters if parameter.name == name)

    def measure(shift: int) -> np.ndarray:
        """Return the misfit of each recorded episode with another delay [nats]."""
        value = getattr(effect, name) * RATIO**shift
        if not bounds.low <= value <= bounds.high:
            return np.full(recordings.max() + 1, np.inf)
        other = [replace(effect, **{name: value}) if place == number else one for place, one in enumerate(effects)]
        try:
            misfits = task.misfits(task.roll_out(task.evidence, other, factors)).sum(1)
        except ModelFileError:
            return np.full(recordings.max() + 1, np.inf)
        return np.bincount(recordings, misfits)

    table = {0: measure(0)}
    for side in (-1, 1):
        for shift in range(side, side * (MOST + 1), side):
            table[shift] = measure(shift)
            if not (table[shift] < table[shift - side]).any():  # no episode gains any more
                break
    return {name: own} if (own := read_range(table, getattr(effect, name))) else {}


def read_range(table: Mapping[int, np.ndarray], delay: float) -> tuple[float, float] | None:
    """Return the range of the delays [s] that single episodes have; None if one delay fits them all.

    Args:
        table: Misfit of each recorded episode [nats], by the shift of the delay.
        delay: Delay at shift 0 [s].
    """
    shifts = sorted(table)
    misfits = np.stack([table[shift] for shift in shifts])
    common = int(misfits.sum(1).argmin())
    own = (misfits[common] - misfits.min(0)) > PARAMETER_PRICE
    if not own.any():
        return None
    values = [delay * RATIO ** shifts[common]]
    values += [delay * RATIO ** find_minimum(np.array(shifts), misfits[:, episode]) for episode in np.flatnonzero(own)]
    return min(values), max(values)


def find_minimum(shifts: np.ndarray, misfits: np.ndarray) -> float:
    """Return the minimum of the parabola through the least misfit and its neighbours."""
    best = int(misfits.argmin())
    if not 0 < best < len(shifts) - 1 or not np.isfinite(misfits[best - 1 : best + 2]).all():
        return float(shifts[best])
    before, least, after = misfits[best - 1 : best + 2]
    return float(shifts[best] + 0.5 * (before - after) / max(before - 2 * least + after, 1e-12))
