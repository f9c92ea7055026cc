"""Tie-break between hypotheses with similar scores, on all training episodes."""

from nas_data.gap.search.constants import PRICE
from nas_data.gap.search.final import measure_columns
from nas_data.gap.search.fit import Fit, fit
from nas_data.gap.search.hypothesis import Hypothesis, reuse_jacobian
from nas_data.gap.search.moves.replace_by_rival import (
    compute_tie_price,
    fit_rivals,
    remember_replaced,
    select_doubted,
)
from nas_data.gap.search.objective import FitTask
from nas_data.gap.search.search import Search


def break_tie(search: Search, train: FitTask, kept: Hypothesis) -> Hypothesis:
    """Return the hypothesis, or the first near rival with a lower loss and price on all training episodes.

    If there are many effects, only those of lowest saliency have rivals. Both are compared at the same tolerance.
    """
    near = [
        (number, rival)
        for number in select_doubted(search, kept)
        for rival in fit_rivals(search, kept, number)
        if rival.score.over(kept.score) < PRICE
    ]
    if not near:
        return kept
    parameters, theta = kept.fit.parameters, kept.fit.theta
    task = train.relinearise(parameters, theta)
    own = refit_on_task(task, kept)
    if own is None:
        return kept
    for number, rival in near:
        restarted = train.reestimate(rival.fit.parameters, rival.fit.theta).with_tolerance_of(task)
        other = refit_on_task(restarted, rival, own)
        price = rival.description.price + compute_tie_price(kept.effects[number], rival.effects[-1])
        if other is not None and other.loss + price < own.loss + kept.description.price:
            search.report("on all episodes, replaced by", rival)
            remember_replaced(search, kept, number, rival)
            return rival
    return kept


def refit_on_task(task: FitTask, h: Hypothesis, near: Fit | None = None) -> Fit | None:
    """Fit a hypothesis to other episodes from its present values, reusing columns of `near`."""
    parameters, theta = h.fit.parameters, h.fit.theta
    known = reuse_jacobian(near, parameters)
    known |= measure_columns(task, parameters, theta, [c for c in range(parameters.size) if c not in known])
    return fit(task, parameters, theta, known, steps=3, jacobian_refreshes=0)
