"""Among effects that the data cannot tell apart, the one that a model file can express."""

from nas_data.gap.search.hypothesis import Hypothesis, place
from nas_data.gap.search.state import Search

TIE = 6.0  # nats by which an effect beyond MJCF must be ahead of one within to be named in its place


def expressible(search: Search, kept: Hypothesis) -> Hypothesis:
    """Replace effects that only a hook can express by rivals that a model file can, where these do as well.

    Friction under load, say, and a lower torque limit are one and the same where nothing is lifted and every move
    saturates the servo: the limit can be written down.
    """
    for number, effect in enumerate(kept.effects):
        if effect.in_model:
            continue
        others = [other for i, other in enumerate(kept.effects) if i != number]
        taken = {place(other) for other in others}
        rivals = [
            rival for rival in search.rivals.get(place(effect), []) if rival.in_model and place(rival) not in taken
        ]
        fitted = [found for rival in rivals if (found := search.rival((*others, rival), kept))]
        best = min(fitted, key=lambda found: found.loss, default=None)
        if best is not None and best.loss < kept.loss + TIE:
            search.report("as good and expressible", best)
            search.rivals[place(best.effects[-1])] = [effect, *search.rivals.get(place(effect), [])]
            return expressible(search, best)
    return kept
