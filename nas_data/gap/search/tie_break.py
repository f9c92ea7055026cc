"""Decide between hypotheses that are nearly as good, on all training episodes."""

from nas_data.gap.search.final import measure_columns
from nas_data.gap.search.fit import Fit, fit
from nas_data.gap.search.hypothesis import Hypothesis, reuse_jacobian
from nas_data.gap.search.moves.replace_by_rival import doubted, fitted_rivals
from nas_data.gap.search.objective import FitTask
from nas_data.gap.search.search import Search

NEAR = 8.0  # nats on the episodes of the search within which a rival may still be the better one on all


def decide(search: Search, train: FitTask, kept: Hypothesis) -> Hypothesis:
    """Return what is kept, or the first near rival that does better on all training episodes at the same tolerance.

    Of many effects, those face rivals that are needed least. The search worked on some of the episodes, which mostly
    tells causes apart. Where it does not, the others may.
    """
    near = [
        rival
        for number in doubted(search, kept)
        for rival in fitted_rivals(search, kept, number)
        if rival.score.over(kept.score) < NEAR
    ]
    if not near:
        return kept
    parameters, theta = kept.fit.parameters, kept.fit.theta
    task = train.relinearise(parameters, theta)
    own = refit(task, kept)
    if own is None:
        return kept
    for rival in near:
        restarted = train.restart(rival.fit.parameters, rival.fit.theta).at_tolerance_of(task)
        other = refit(restarted, rival, own)
        if other is not None and other.loss + rival.description.cost < own.loss + kept.description.cost:
            search.report("on all episodes it yields to", rival)
            return rival
    return kept


def refit(task: FitTask, h: Hypothesis, near: Fit | None = None) -> Fit | None:
    """Fit a hypothesis to other episodes, from where it is; `near` lends columns of its Jacobian."""
    parameters, theta = h.fit.parameters, h.fit.theta
    known = reuse_jacobian(near, parameters)
    known |= measure_columns(task, parameters, theta, [c for c in range(parameters.size) if c not in known])
    return fit(task, parameters, theta, known, steps=3, jacobian_refreshes=0)
