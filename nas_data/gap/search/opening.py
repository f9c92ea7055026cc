"""Choose between effects that all joints may have: by where each leads, for the first fit tells them apart poorly."""

from collections.abc import Sequence

from nas_data.gap.search.grow import extensions, promising
from nas_data.gap.search.hypothesis import Hypothesis, worth
from nas_data.gap.search.state import Search

OPENINGS = 2  # that are followed one step further


def opened(search: Search, kept: Hypothesis, ranked: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Return hypotheses best first; those with one effect in several joints ordered, and continued, by where they lead.

    A servo far softer than its model needs friction beside it before it explains what a dead band explains alone: where
    all joints lack the same two things, the first of them may look worse by itself than a wrong one, in all joints or
    in one. So both steps are taken at once.

    Args:
        search: Search.
        kept: Hypothesis so far.
        ranked: Those that one more step makes, the best first.
    """
    several = [h for h in ranked if len(h.effects) > len(kept.effects) + 1 and promising(search, kept, h)][:OPENINGS]
    if len(several) < OPENINGS or ranked[0] is not several[0]:
        return list(ranked)
    leads = [min([h, *extensions(search, h, h.fit)], key=worth) for h in several]
    best = min(leads, key=worth)
    search.report("  opening", best)
    return [best, *ranked]
