"""Decide between effects that do nearly as well, on all training episodes."""

from nas_data.gap.search.final import Final, finish
from nas_data.gap.search.fit import Task
from nas_data.gap.search.hypothesis import Hypothesis
from nas_data.gap.search.rivals import SPARE, fitted_rivals
from nas_data.gap.search.state import Search

NEAR = 8.0  # nats on the episodes of the search within which a rival may still be the better one on all


def decided(search: Search, train: Task, kept: Hypothesis) -> tuple[Hypothesis, Final]:
    """Return what is kept and its last fit, on all training episodes; near rivals are fitted to as many.

    The search worked on some of the episodes, which mostly tells causes apart. Where it does not, the others may.
    """
    final = finish(train, kept.effects, kept.fit.factors)
    for number in range(len(kept.effects)):
        for rival in fitted_rivals(search, kept, number):
            if rival.loss > kept.loss + NEAR:
                break
            other = finish(train, rival.effects, rival.fit.factors)
            more = max(0, len(rival.effects[-1].sought) - len(kept.effects[number].sought))
            if other.loss < final.loss - SPARE * more:
                search.report(f"on all episodes {kept.effects[number].name()} yields to", rival)
                return rival, other
    return kept, final
