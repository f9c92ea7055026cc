"""Scan parameters of effects over their range, for losses with many local minima."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from nas_data.gap.search.constants import FAR_ABOVE, MAX_ROUNDS, PRICE
from nas_data.gap.search.fit import Fit, evaluate_loss
from nas_data.gap.search.hypothesis import Hypothesis
from nas_data.gap.search.objective import FitTask
from nas_data.gap.search.parameters import FreeParameters
from nas_data.gap.search.score import Score
from nas_data.gap.search.search import Search
from nas_data.gap.side_by_side import map_in_parallel
from nas_data.simulators.initial_states import InitialLoad

# Spacing and half range of scans, in logarithms. The first covers a tenth to ten times of a value at the spacing of the
# local minima in a play's width; the next refine the best value.
SCANS = ((0.14, 2.4), (0.02, 0.16), (0.004, 0.024))
PERTURBATION = 1e-4  # [rad] of initial positions, below encoder resolution, to test for chaos
CHAOTIC = 0.1  # change of rollouts over their errors above which the arm is chaotic


def apply(search: Search, h: Hypothesis) -> Hypothesis:
    """Scan the parameters of a chaotic arm; see `scan_parameters`."""
    return scan_parameters(search, h)


def find_joints_far_above(search: Search, kept: Hypothesis) -> list[str]:
    """Return the excited joints that are far from explained."""
    rest = zip(search.train.nominal.joints, search.floor_ratios(kept), strict=True)
    return [joint for joint, left in rest if left > FAR_ABOVE and joint in search.excited]


def scan_parameters(search: Search, h: Hypothesis, anyway: bool = False) -> Hypothesis:
    """Return a hypothesis with the best values of a scan, to be fitted further.

    Play that is excited strongly makes an arm chaotic, so that gradients do not lead to the right width. The assumed
    initial side of the play also matters: a play that lies at one side looks twice as wide. So two scans are made, from
    the fit with its initial loads, and from the model's own parameters with gravity loads.

    Args:
        search: Search.
        h: Hypothesis; returned unchanged if every joint is near, the arm is not chaotic, or no scan gains enough.
        anyway: Make a coarse scan also if the arm is not chaotic.
    """
    columns = select_columns(search, h)
    scans = SCANS if columns and is_chaotic(search.task, h) else SCANS[:1] if anyway else ()
    if not columns or not scans:
        return h
    parameters, theta = h.fit.parameters, h.fit.theta
    own = np.where(np.arange(parameters.size) < len(parameters.effect_parameters), theta, 0.0)
    task = search.task.select(np.arange(0, len(search.task.evidence), 2)).with_own_timestep()
    settled = replace(task, evidence=task.evidence.with_initial_loads(InitialLoad.GRAVITY))
    before = evaluate_loss(task, parameters, theta)
    starts = ((task, theta), (settled, own))
    ends = [scan(each, parameters, first, columns, scans) for each, first in starts]
    best, reached = min(ends, key=lambda end: end[1])
    if reached > before + -PRICE:
        return h
    predicted = search.task.predict(parameters, best)
    if predicted is None:
        return h
    misfit = search.task.misfit(predicted)
    there = Fit(parameters, best, predicted, misfit, h.fit.jacobian, search.task.objective)
    found = search.evaluate(h.description, there)
    search.report("  scanned", found)
    return found


def select_columns(search: Search, h: Hypothesis) -> list[int]:
    """Return the columns of effects in joints that are far from explained."""
    joints = find_joints_far_above(search, h)
    own = [
        {effect.local_joint for effect in h.fit.parameters.effects_of(c)}
        for c in range(len(h.fit.parameters.effect_parameters))
    ]
    return [column for column, places in enumerate(own) if places & {*joints} or (joints and None in places)]


def is_chaotic(task: FitTask, h: Hypothesis) -> bool:
    """Whether a perturbation of the initial positions changes rollouts about as much as their errors."""
    nudged = replace(
        task, evidence=replace(task.evidence, initial_positions=task.evidence.initial_positions + PERTURBATION)
    )
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
    """Return the best θ of scans along single parameters, repeated while they gain enough, and its loss."""
    best, reached = theta, evaluate_loss(task, parameters, theta)
    for apart, reach in scans:
        for _ in range(MAX_ROUNDS):
            before = reached
            for column in columns:
                places = vary_column(parameters, best, column, np.arange(-reach, reach + apart, apart))
                losses = map_in_parallel(partial(evaluate_loss, task, parameters), places)
                if min(losses) < reached:
                    least = min(range(len(losses)), key=lambda place: losses[place].nats)
                    best, reached = places[least], losses[least]
            if reached > before + -PRICE:
                break
    return best, reached


def vary_column(parameters: FreeParameters, theta: np.ndarray, column: int, changes: np.ndarray) -> list[np.ndarray]:
    """Return copies of θ in which one parameter is changed, for the changes within bounds."""
    low, high = (float(ends[column]) for ends in parameters.bounds())
    values = changes + theta[column]
    values = values[(values >= low) & (values <= high)]
    return [np.where(np.arange(parameters.size) == column, value, theta) for value in values]
