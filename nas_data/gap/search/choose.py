"""Choose the effects: add what helps, several joints at once, then drop what held-out episodes do not need."""

from nas_data.gap.search.detail import detailed
from nas_data.gap.search.exchange import exchanged
from nas_data.gap.search.grow import AT_FLOOR, extensions, grown, is_full, overlooked
from nas_data.gap.search.hop import hopped
from nas_data.gap.search.hypothesis import Hypothesis, strained, worth
from nas_data.gap.search.join import joined
from nas_data.gap.search.opening import opened
from nas_data.gap.search.prune import adequate, pruned, simplified
from nas_data.gap.search.state import Search
from nas_data.gap.search.sweep import far, swept
from nas_data.gap.side_by_side import side_by_side

LITTLE = 0.05  # of all that was gained, which then is too little to go on


def choose(search: Search) -> Hypothesis:
    """Search and return the hypothesis that is kept."""
    kept, around = search.null, search.nominal.fit
    if not search.lively:
        return kept
    while not is_full(search, kept) and (search.ratio(kept).max() > AT_FLOOR or strained(kept)):
        ranked = extensions(search, kept, around)
        larger = grown(search, kept, ranked if kept.effects else opened(search, kept, ranked))
        if larger is None and around is not kept.fit:
            larger = grown(search, kept, extensions(search, kept, kept.fit))
        larger = larger or grown(search, kept, overlooked(search, kept))
        if larger is None:
            break
        larger = exchanged(search, search.refined(swept(search, larger)))
        before, kept = kept, detailed(search, hopped(search, joined(search, larger)))
        search.report("added", kept)
        if lost(search, before, kept):
            break
        around = kept.fit
    kept = persisted(search, needed(search, pruned(search, kept)))
    there = hopped(search, kept)  # what bent to the first delay has been fitted since
    return kept if there is kept else needed(search, there)


def needed(search: Search, kept: Hypothesis) -> Hypothesis:
    """Return what is left of a hypothesis when all that does as well without is dropped."""
    return pruned(search, adequate(search, simplified(search, kept)))


def persisted(search: Search, kept: Hypothesis) -> Hypothesis:
    """Fit on, and drop anew, as long as that brings much and a joint that moved is far from explained.

    Wide play and strong friction bend each other's best value: a fit goes along a narrow valley in more steps than any
    of those that compared names were given, and stand-ins that helped half-way fall off at its end. Where going on
    brings little, it begins anew.
    """
    while kept.effects and far(search, kept):
        before, kept = kept, search.continued(search.refined(swept(search, kept)))
        if not much(search, before, kept):
            anew = begun_anew(search, kept)
            better = anew if anew is not None and much(search, kept, anew) else looked_along(search, kept)
            if better is None:
                break
            kept = better
        kept = needed(search, kept)
        search.report("fitted on", kept)
    return kept


def begun_anew(search: Search, kept: Hypothesis) -> Hypothesis | None:
    """Return the best of the effects, all or without one, fitted from the model's own base; None where they diverge.

    The base bends to a stand-in taken on the way, and then neither lets go of the other.
    """
    rests = [kept.effects[:number] + kept.effects[number + 1 :] for number in range(len(kept.effects))]
    fitted = side_by_side(lambda effects: search.fitted(effects, {}, renewals=1), [kept.effects, *filter(None, rests)])
    return min(filter(None, fitted), key=worth, default=None)


def looked_along(search: Search, kept: Hypothesis) -> Hypothesis | None:
    """Return what is reached from where a look along the parameters leads; None where that brings little.

    Play that seems to lie in its middle looks half as wide as it is, and no slope leads from there to its whole.
    """
    task, held = search.sub, search.held
    found = swept(search, kept, anyway=True)
    found = kept if found is kept else search.continued(search.refined(found))
    if much(search, kept, found):
        return found
    search.sub, search.held = task, held
    return None


def lost(search: Search, before: Hypothesis, kept: Hypothesis) -> bool:
    """Whether a step brought little while every joint that moved is far from explained.

    What is missing then is not in the catalogue, or a description that names it was passed by; either way further names
    would only be bent to these motions.
    """
    return set(far(search, kept)) == search.lively and not much(search, before, kept)


def much(search: Search, before: Hypothesis, after: Hypothesis) -> bool:
    """Return whether a step brought much of all that was gained since nothing was added."""
    return before.loss - after.loss >= LITTLE * (search.null.loss - after.loss)
