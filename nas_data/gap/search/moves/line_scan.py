"""Scan along the effects' parameters from end to end: a fit goes down into the nearest dip, and stops make many."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from nas_data.gap.search.fit import Fit, loss
from nas_data.gap.search.hypothesis import PRICE, Hypothesis
from nas_data.gap.search.objective import FitTask, Score
from nas_data.gap.search.parameters import FreeParameters
from nas_data.gap.search.search import ROUNDS, Search
from nas_data.gap.side_by_side import side_by_side
from nas_data.simulators.initial_states import InitialLoad

UNEXPLAINED = 5.0  # noise floors of rest from which a joint is far from explained
# Between neighbouring values and how far either way, in logarithms: first as wide apart as the dips of a play's width
# are, from a tenth to ten times; then about the best, and closer yet
SCANS = ((0.14, 2.4), (0.02, 0.16), (0.004, 0.024))
NUDGE = 1e-4  # [rad] by which starts are off, less than encoders tell, to see whether an arm is chaotic
CHAOTIC = 0.1  # part of the errors that rollouts then change by, from which it is


def apply(search: Search, h: Hypothesis) -> Hypothesis:
    """Scan the parameters of a chaotic arm; see `scan_parameters`."""
    return scan_parameters(search, h)


def unexplained_joints(search: Search, kept: Hypothesis) -> list[str]:
    """Return the joints that moved and are far from explained."""
    rest = zip(search.train.nominal.joints, search.ratio(kept), strict=True)
    return [joint for joint, left in rest if left > UNEXPLAINED and joint in search.excited]


def scan_parameters(search: Search, h: Hypothesis, anyway: bool = False) -> Hypothesis:
    """Return a hypothesis with the best numbers that a scan along the parameters finds, to be fitted on from there.

    An arm that play throws to and fro is chaotic: it is predicted no better with three quarters of the play's width
    than with a half, so that no slope leads to the right one. And play that lies at one side until the load first
    reverses looks like play twice as wide that lies in its middle. So one scan is from where the fit ended, with what
    seemed to hold the joints before, another from the model's own parameters, with its weight to hold it.

    Args:
        search: Search.
        h: Hypothesis; as it is where all joints are near, the arm is not chaotic, or no scan leads much further.
        anyway: Scan even where the arm is not chaotic, though not closely: slopes lead on from there.
    """
    columns = scanned_columns(search, h)
    scans = SCANS if columns and is_chaotic(search.sub, h) else SCANS[:1] if anyway else ()
    if not columns or not scans:
        return h
    parameters, theta = h.fit.parameters, h.fit.theta
    own = np.where(np.arange(parameters.size) < len(parameters.of_effects), theta, 0.0)
    task = search.sub.select(np.arange(0, len(search.sub.evidence), 2)).at_own_steps()
    settled = replace(task, evidence=task.evidence.begun(InitialLoad.GRAVITY))
    before = loss(task, parameters, theta)
    starts = ((task, theta), (settled, own))
    ends = [scan(each, parameters, first, columns, scans) for each, first in starts]
    best, reached = min(ends, key=lambda end: end[1])
    if reached > before + -PRICE:
        return h
    predicted = search.sub.predict(parameters, best)
    if predicted is None:
        return h
    misfit = search.sub.misfit(predicted)
    there = Fit(parameters, best, predicted, misfit, h.fit.jacobian, search.sub.objective)
    found = search.judge(h.description, there)
    search.report("  scanned", found)
    return found


def scanned_columns(search: Search, h: Hypothesis) -> list[int]:
    """Return the numbers that are scanned: those of effects in joints that are far from explained."""
    joints = unexplained_joints(search, h)
    own = [
        {effect.joint for effect in h.fit.parameters.parameters_of(c)} for c in range(len(h.fit.parameters.of_effects))
    ]
    return [column for column, places in enumerate(own) if places & {*joints} or (joints and None in places)]


def is_chaotic(task: FitTask, h: Hypothesis) -> bool:
    """Whether starts off by less than encoders tell change rollouts of a hypothesis as other numbers might."""
    nudged = replace(task, evidence=replace(task.evidence, initial_positions=task.evidence.initial_positions + NUDGE))
    one, other = (each.predict(h.fit.parameters, h.fit.theta) for each in (task, nudged))
    if one is None or other is None:
        return False
    return float(np.square(other - one).mean()) > CHAOTIC**2 * float(task.evidence.mean_squares(one).mean())


def scan(
    task: FitTask,
    parameters: FreeParameters,
    theta: np.ndarray,
    columns: Sequence[int],
    scans: Sequence[tuple[float, float]] = SCANS,
) -> tuple[np.ndarray, Score]:
    """Return the best numbers along one parameter after the other, again until that brings little, and their loss."""
    best, reached = theta, loss(task, parameters, theta)
    for apart, reach in scans:
        for _ in range(ROUNDS):
            before = reached
            for column in columns:
                places = along(parameters, best, column, np.arange(-reach, reach + apart, apart))
                losses = side_by_side(partial(loss, task, parameters), places)
                if min(losses) < reached:
                    least = min(range(len(losses)), key=lambda place: losses[place].nats)
                    best, reached = places[least], losses[least]
            if reached > before + -PRICE:
                break
    return best, reached


def along(parameters: FreeParameters, theta: np.ndarray, column: int, changes: np.ndarray) -> list[np.ndarray]:
    """Return numbers of which one is changed, once for each change that its bounds allow."""
    low, high = (float(ends[column]) for ends in parameters.bounds())
    values = changes + theta[column]
    values = values[(values >= low) & (values <= high)]
    return [np.where(np.arange(parameters.size) == column, value, theta) for value in values]
