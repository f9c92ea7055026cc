"""The search: up from the model as it is and down from the plain fit, by the same moves; the better score is kept."""

from collections.abc import Container

from nas_data.gap.search.fit import fit
from nas_data.gap.search.hypothesis import Hypothesis
from nas_data.gap.search.moves import add, drop, line_scan, restart
from nas_data.gap.search.moves.base import find_move
from nas_data.gap.search.plain_fit import as_effects, columns_as_effects
from nas_data.gap.search.search import LITTLE, Round, Search

ROUND = ("swap", "merge_joints", "shift_delay", "optional_parameters")  # after each addition
# when nothing is added any more
REVIEW = ("share_value", "simplify", "drop", "replace_by_rival", "shift_delay", "drop")
EXPLAINED = 1.5  # noise floors of rest up to which a joint counts as explained
MANY = 2  # parts of the pruned plain fit for each joint from which nearly everything is missing
FEW = 3  # parts of the pruned plain fit that are believed where they bring every joint to the floor
FEW_JOINTS = 2  # above the floor, from which the search climbs at once where the plain fit leaves much
MOST = 4  # effects for each joint of an arm


def choose(search: Search, plain: Hypothesis, without: Container[str] = ()) -> Hypothesis:
    """Search from both ends and return the hypothesis that is kept.

    What is left of the plain fit when all that is not worth its price is dropped decides where to begin. Where it
    holds many parts, nearly everything is missing everywhere: adding one thing at a time to the model goes astray,
    and the search goes on from there alone, unless the first addition to the model is better already. Where it
    brings every joint to the floor with few parts, or with parts of one kind, it is only reviewed.

    Args:
        search: Search.
        plain: The plain fit.
        without: Names of moves that are left out.
    """
    if not search.above_floor(search.null):
        return search.null
    first, early = search.round, None
    if not is_explained(search, plain) and len(search.above_floor(search.null)) <= FEW_JOINTS:
        early = climb(search, search.null, without)
        free = search.rescore(plain)
        if is_explained(search, early) and early.score < free.fit.loss + free.heldout_misfit:
            return early
        search.return_to(first)
    down = descend(search, plain, without)
    begun = None
    if is_large := len(drop.parts(down)) > MANY * len(search.excited):
        there = search.round
        search.return_to(first)
        begun = add.add_first(search)
        if not (begun.score < search.rescore(down).score and is_ahead(search, begun, down, there)):
            search.return_to(there)
            return climb(search, search.relinearise(down), without)
    elif not search.above_floor(down) and is_simple(down):
        return review(search, apply_moves(search, down, ("merge_joints", "one_for_several"), without), without)
    up = early
    if up is None:
        search.return_to(first)
        up = climb(search, search.null, without, down if is_explained(search, down) else None, begun)
    up = search.rescore(up)
    if (is_large or is_explained(search, up)) and up.score <= search.rescore(down).score:
        return search.relinearise(up) if early else up
    down = climb(search, search.relinearise(down), without)
    up = search.rescore(up)
    search.report("up from the model", up)
    search.report("down from the plain fit", down)
    return min(up, down, key=lambda h: h.score)


def is_ahead(search: Search, h: Hypothesis, other: Hypothesis, round_: Round) -> bool:
    """Whether one hypothesis is better than another by the objective of a round, to which the search then goes."""
    search.return_to(round_)
    return search.rescore(h).score < search.rescore(other).score


def climb(
    search: Search,
    h: Hypothesis,
    without: Container[str] = (),
    rival: Hypothesis | None = None,
    begun: Hypothesis | None = None,
) -> Hypothesis:
    """Add effects one after the other, with the moves of a round after each; then review what there is.

    Args:
        search: Search.
        h: Where to begin.
        without: Names of moves that are left out.
        rival: What there is already; the climb ends when a round does not come near it.
        begun: The first addition, where it is known.
    """
    while len(h.effects) < MOST * len(search.excited) and search.above_floor(h):
        larger, begun = begun or add.apply(search, h), None
        if larger is h:
            break
        gained = search.null.score.over(h.score)
        h = apply_moves(search, search.relinearise(line_scan.apply(search, larger)), ROUND, without)
        search.report("added", h)
        if is_lost(search, h, gained) or (rival and h.score > search.rescore(rival).score):
            break
    return review(search, h, without)


def review(search: Search, h: Hypothesis, without: Container[str] = ()) -> Hypothesis:
    """Doubt everything once more when nothing is added any more."""
    return persist(search, apply_moves(search, h, REVIEW, without), without)


def descend(search: Search, plain: Hypothesis, without: Container[str] = ()) -> Hypothesis:
    """Name what the plain fit does, and drop what is not worth its price."""
    search.say("  writing the plain fit as effects")
    description = as_effects(search, plain)
    parameters = description.parameters(search.train.nominal.base)
    known = columns_as_effects(plain.fit, parameters)
    found = fit(search.sub, parameters, parameters.start(plain.fit.factors), known, jacobian_refreshes=0)
    if found is None:
        return search.rescore(plain)
    named = search.relinearise(search.judge(description, found))
    search.report("  as effects", named)
    return apply_moves(search, named, ("share_value", "drop"), without)


def is_simple(h: Hypothesis) -> bool:
    """Whether a hypothesis has few parts, or one effect in several joints."""
    kinds = {part if isinstance(part, str) else part.name() for part in drop.parts(h)}
    return len(drop.parts(h)) <= FEW or len(kinds) == 1


def is_explained(search: Search, h: Hypothesis) -> bool:
    """Whether every joint that moved is near the noise floor."""
    return bool(search.ratio(h)[excited_indices(search)].max() <= EXPLAINED)


def apply_moves(search: Search, h: Hypothesis, names: tuple[str, ...], without: Container[str]) -> Hypothesis:
    """Apply moves one after the other; one that found nothing better is not applied again to the same hypothesis."""
    idle: dict[str, Hypothesis] = {}
    for name in names:
        if name not in without and idle.get(name) is not h:
            before, h = h, find_move(name)(search, h)
            if h is before or name == "drop":  # which ends where it finds nothing more
                idle[name] = h
    return h


def persist(search: Search, h: Hypothesis, without: Container[str]) -> Hypothesis:
    """Fit on, scan and begin anew, as long as that brings much and a joint that moved is far from explained.

    Wide play and strong friction bend each other's best value: a fit goes along a narrow valley in more steps than any
    of those that compared names were given, and stand-ins that helped half-way fall off at its end. Where there
    are many effects, fits of each of them would take minutes.
    """
    while 0 < len(h.effects) <= drop.MANY and line_scan.unexplained_joints(search, h):
        before = search.null.score.over(h.score)
        h = search.relinearise(line_scan.apply(search, h))
        better = restart.apply(search, h)
        if better is h:
            better = line_scan.scan_parameters(search, h, anyway=True)
        if better is not h:
            h = search.relinearise(better)
        gained = search.null.score.over(h.score)
        if gained - before < LITTLE * gained:
            break
        h = apply_moves(search, h, REVIEW, without)
        search.report("fitted on", h)
    return h


def is_lost(search: Search, h: Hypothesis, gained_before: float) -> bool:
    """Whether a step brought little while every joint that moved is far from explained.

    What is missing then is not in the catalogue, or a description that names it was passed by; either way further names
    would only be bent to these motions.
    """
    gained = search.null.score.over(h.score)
    lost = set(line_scan.unexplained_joints(search, h)) == search.excited
    return lost and gained - gained_before < LITTLE * gained


def excited_indices(search: Search) -> list[int]:
    """Return the indices of the joints that moved."""
    return [place for place, joint in enumerate(search.train.nominal.joints) if joint in search.excited]
