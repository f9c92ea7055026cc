"""Command shift: whether the arm follows its commands some rows later or earlier than the model."""

from dataclasses import replace

import numpy as np

from nas_data.arrays import thin_evenly
from nas_data.count_of import count_of, join_items
from nas_data.errors import ModelFileError
from nas_data.gap.episode_batch import EpisodeBatch
from nas_data.gap.finding.audits import Examined
from nas_data.gap.report_parts import Check

SHIFTS = (-3, -2, -1, 0, 1, 2, 3)  # [rows] by which commands are shifted; positive is later
SLIPS = 2  # [rows] largest shift that an error of the log explains
WINDOW = 0.1  # [s] over which motions are compared, so that static errors cancel
MAX_ERROR_RATIO = 0.9  # largest ratio of errors with over without a shift that is clearly better
MIN_EPISODE_SHARE = 0.75  # smallest share of the episodes in which it is
EPISODES = 16  # most episodes that are compared
SECONDS = 20.0  # [s] of each
MIN_ERROR = 2.0  # smallest error, in standard deviations of a difference of two readings


def check_command_shift(examined: Examined) -> Check:
    """Report joints whose motion fits clearly better with shifted commands."""
    best, visible = find_best_shifts(examined)
    if not best.any():
        return Check(
            "command shift", "No joint follows its commands clearly better when these are shifted by one or two rows."
        )
    notes, ok = [], True
    for shift in np.unique(best[best != 0]).tolist():
        alike = (np.sign(best) == np.sign(shift)) & (best <= SLIPS)
        slip = shift <= SLIPS and 2 * alike.sum() > visible.sum()
        notes.append(describe_shift(select_names(examined, best == shift), shift, slip, examined.nominal.period))
        ok &= not slip
    return Check("command shift", " ".join(notes), ok)


def select_names(examined: Examined, chosen: np.ndarray) -> str:
    """Return the names of chosen joints (n,)."""
    if chosen.all():
        return "all joints"
    return join_items([joint for joint, is_chosen in zip(examined.nominal.joints, chosen, strict=True) if is_chosen])


def describe_shift(joints: str, shift: int, slip: bool, period: float) -> str:
    """Describe a shift of some joints; `slip` marks an error of the log, on which most joints agree."""
    amount = f"{count_of(abs(shift), 'row')} ({abs(shift) * period * 1e3:.3g} ms)"
    if shift > SLIPS:
        return (
            f"The motion of {joints} is {amount} or more later than in the model, which is more than misaligned rows "
            "of a log explain: the servo is slower than the model, or there is a command_delay."
        )
    if not slip:
        later, slower = ("later", "a command_delay, or a servo slower") if shift > 0 else ("earlier", "a servo faster")
        return (
            f"The motion of {joints} starts about {amount} {later} than in the model, but most joints show no clear "
            f"shift: {slower} than the model is more likely than misaligned rows of the log."
        )
    if shift < 0:
        return (
            f"Commands look {amount} late: the motion of {joints} starts before the logged commands. No delay can "
            "cause this. If the state of a row was read after its command was sent, import the log with alignment = "
            "'state_follows_action' in the map, which shifts commands up by one row; otherwise check the speed of the "
            "model."
        )
    return (
        f"Commands look {amount} early: the motion of {joints} starts later than in the model. The log may pair each "
        "state with a command sent later: if its map says alignment = 'state_follows_action', import it with "
        "'action_follows_state', which shifts commands down by one row. Otherwise the lag is real: a command_delay, or "
        "a servo slower than the model."
    )


def find_best_shifts(examined: Examined) -> tuple[np.ndarray, np.ndarray]:
    """Return the best clear shift of each joint [rows], 0 without one, and which joints have a gap, shape (n,) each."""
    errors = np.stack([measure_shift_errors(examined, shift) for shift in SHIFTS])
    usual = errors[SHIFTS.index(0)]
    ratios = errors / usual
    visible = np.median(usual, axis=0) > MIN_ERROR * np.sqrt(2) * examined.floor
    clear = (
        (np.median(ratios, axis=1) < MAX_ERROR_RATIO)
        & ((ratios < MAX_ERROR_RATIO).mean(axis=1) >= MIN_EPISODE_SHARE)
        & visible
    )
    best = np.argmin(np.where(clear, np.median(ratios, axis=1), np.inf), axis=0)
    return np.where(clear.any(axis=0), np.array(SHIFTS)[best], 0), visible


def measure_shift_errors(examined: Examined, shift: int) -> np.ndarray:
    """Return the error of motions over a short window with shifted commands [rad; m], shape (E, n)."""
    whole = examined.recorded.evidence
    evidence = whole.select(thin_evenly(len(whole), EPISODES)).first(round(SECONDS / whole.period))
    positional = examined.nominal.simulator().layout.inputs.positional
    try:
        predicted = examined.nominal.predict(shift_commands(evidence, shift, positional))
    except ModelFileError:
        return np.full(evidence.initial_positions.shape, np.inf)
    rows = max(1, round(WINDOW / evidence.period))
    error = predicted - evidence.measured
    moves = np.where(evidence.mask[:, rows:, None], error[:, rows:] - error[:, :-rows], 0.0)
    seen = np.maximum(evidence.mask[:, rows:].sum(1), 1)[:, None]
    return np.sqrt((moves**2).sum(1) / seen) + np.finfo(float).eps


def shift_commands(evidence: EpisodeBatch, shift: int, positional: np.ndarray) -> EpisodeBatch:
    """Return episodes with commands shifted by some rows.

    Before the first row, a position command is the initial pose. Any other command (`positional` (n,) is false) is the
    first one.
    """
    commands, steps = evidence.commands, evidence.commands.shape[1]
    before = np.where(positional, evidence.initial_positions[:, None], commands[:, :1])
    if shift >= 0:
        moved = np.concatenate([np.repeat(before, shift, axis=1), commands[:, : steps - shift]], axis=1)
    else:
        moved = np.concatenate([commands[:, -shift:], np.repeat(commands[:, -1:], -shift, axis=1)], axis=1)
    return replace(evidence, commands=moved)
