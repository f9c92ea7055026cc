"""Look along the effects' parameters from end to end: a fit goes down into the nearest dip, and stops make many."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from nas_data.gap.search.fit import Fit, Task, loss
from nas_data.gap.search.hypothesis import GAIN, Hypothesis
from nas_data.gap.search.state import Search
from nas_data.gap.search.unknowns import Unknowns
from nas_data.gap.side_by_side import side_by_side
from nas_data.simulators.settled import Hold

FAR = 5.0  # noise floors of rest from which a joint is far from explained
# Between neighbouring values and how far either way, in logarithms: first as wide apart as the dips of a play's width
# are, from a tenth to ten times; then about the best, and closer yet
LOOKS = ((0.14, 2.4), (0.02, 0.16), (0.004, 0.024))
ROUNDS = 3  # over all parameters, at most
NUDGE = 1e-4  # [rad] by which starts are off, less than encoders tell, to see whether an arm is chaotic
CHAOTIC = 0.1  # part of the errors that rollouts then change by, from which it is


def far(search: Search, kept: Hypothesis) -> list[str]:
    """Return the joints that moved and are far from explained."""
    rest = zip(search.train.nominal.joints, search.ratio(kept), strict=True)
    return [joint for joint, left in rest if left > FAR and joint in search.lively]


def swept(search: Search, h: Hypothesis, anyway: bool = False) -> Hypothesis:
    """Return a hypothesis with the best numbers that a look along the parameters finds, to be fitted on from there.

    An arm that play throws to and fro is chaotic: it is predicted no better with three quarters of the play's width
    than with a half, so that no slope leads to the right one. And play that lies at one side until the load first
    reverses looks like play twice as wide that lies in its middle. So one look is from where the fit ended, with what
    seemed to hold the joints before, another from the model's own base, with its weight to hold it.

    Args:
        search: Search.
        h: Hypothesis; as it is where all joints are near, the arm is not chaotic, or no look leads much further.
        anyway: Look even where the arm is not chaotic, though not closely: slopes lead on from there.
    """
    columns = concerned(search, h)
    looks = LOOKS if columns and chaotic(search.sub, h) else LOOKS[:1] if anyway else ()
    if not columns or not looks:
        return h
    unknowns, numbers = h.fit.unknowns, h.fit.numbers
    own = np.where(np.arange(unknowns.size) < len(unknowns.sought), numbers, 0.0)
    task = replace(search.halved(h.fit)[0], correction=0.0)
    settled = replace(task, evidence=task.evidence.begun(Hold.WEIGHT))
    before = loss(task, unknowns, numbers)
    ends = [look(task, unknowns, numbers, columns, looks), look(settled, unknowns, own, columns, looks)]
    best, reached = min(ends, key=lambda end: end[1])
    if reached > before - GAIN:
        return h
    predicted = search.sub.predict(unknowns, best)
    if predicted is None:
        return h
    found = search.judged(Fit(unknowns, best, predicted, search.sub.misfit(predicted), h.fit.slopes))
    search.report("  looked along", found)
    return found


def concerned(search: Search, h: Hypothesis) -> list[int]:
    """Return the numbers that are looked along: those of effects in joints that are far from explained."""
    joints = far(search, h)
    places = [h.fit.unknowns.effects[unknown.place].joint for unknown in h.fit.unknowns.sought]
    return [number for number, joint in enumerate(places) if joint in joints or (joints and joint is None)]


def chaotic(task: Task, h: Hypothesis) -> bool:
    """Whether starts off by less than encoders tell change rollouts of a hypothesis as other numbers might."""
    nudged = replace(task, evidence=replace(task.evidence, starts=task.evidence.starts + NUDGE))
    one, other = (each.predict(h.fit.unknowns, h.fit.numbers) for each in (task, nudged))
    if one is None or other is None:
        return False
    return float(np.square(other - one).mean()) > CHAOTIC**2 * float(task.evidence.mean_squares(one).mean())


def look(
    task: Task,
    unknowns: Unknowns,
    numbers: np.ndarray,
    columns: Sequence[int],
    looks: Sequence[tuple[float, float]] = LOOKS,
) -> tuple[np.ndarray, float]:
    """Return the best numbers along one parameter after the other, again until that brings little, and their loss."""
    best, reached = numbers, loss(task, unknowns, numbers)
    for apart, reach in looks:
        for _ in range(ROUNDS):
            before = reached
            for column in columns:
                places = along(unknowns, best, column, np.arange(-reach, reach + apart, apart))
                losses = side_by_side(partial(loss, task, unknowns), places)
                if min(losses) < reached:
                    best, reached = places[int(np.argmin(losses))], min(losses)
            if reached > before - GAIN:
                break
    return best, reached


def along(unknowns: Unknowns, numbers: np.ndarray, column: int, changes: np.ndarray) -> list[np.ndarray]:
    """Return numbers of which one is changed, once for each change that its bounds allow."""
    low, high = (float(ends[column]) for ends in unknowns.bounds())
    values = changes + numbers[column]
    values = values[(values >= low) & (values <= high)]
    return [np.where(np.arange(unknowns.size) == column, value, numbers) for value in values]
