"""Strategy of the search: search up from the model and down from the plain fit, and keep the better score."""

from collections.abc import Container

from nas_data.gap.search.fit import fit
from nas_data.gap.search.hypothesis import Hypothesis
from nas_data.gap.search.moves import add, drop, line_scan, restart
from nas_data.gap.search.moves.base import find_move
from nas_data.gap.search.plain_fit import add_limits, convert_columns, convert_to_effects
from nas_data.gap.search.search import EXPLAINED, LITTLE, Round, Search

MOVES_AFTER_ADDITION = ("swap", "merge_joints", "shift_delay", "optional_parameters")  # after each addition
# when nothing is added any more
MOVES_OF_REVIEW = ("share_value", "simplify", "drop", "replace_by_rival", "shift_delay", "drop")
MANY_PARTS = 2  # parts per joint of the pruned plain fit above which nearly everything is missing
AHEAD = 0.5  # share of the gain by which the search upwards must lead to end the search without explaining every joint
FEW_PARTS = 3  # most parts of a pruned plain fit that is kept if it explains every joint
FEW_JOINTS = 2  # most joints above the floor with which the search starts upwards if the plain fit fails
MAX_EFFECTS = 4  # effects per excited joint


def choose(
    search: Search, first: Round, plain: Hypothesis, without: Container[str] = ()
) -> tuple[Hypothesis, Hypothesis]:
    """Search in both directions and return the best hypothesis, and the plain fit.

    If few joints are above the floor and the smooth fit does not explain them, effects are added to the model first.
    Limits are added to the plain fit only if those effects do not explain the joints either.

    Args:
        search: Search at the objective of the smooth fit.
        first: Objective of the search before it.
        plain: Smooth fit.
        without: Names of moves to leave out.

    Returns:
        The hypothesis with the best score, and the plain fit.
    """
    there = search.current_round
    search.return_to(first)
    if not search.find_joints_above_floor(search.null):
        return search.null, plain
    early = None
    if not is_explained(search, plain) and len(search.find_joints_above_floor(search.null)) <= FEW_JOINTS:
        early = search_up(search, search.null, without)
        free = search.rescore(plain)
        if is_explained(search, early) and early.score < free.fit.loss + free.heldout_misfit:
            return early, plain
    search.return_to(there)
    plain = add_limits(search, plain)
    search.return_to(first)
    return search_both(search, first, plain, early, without), plain


def search_both(
    search: Search, first: Round, plain: Hypothesis, early: Hypothesis | None, without: Container[str]
) -> Hypothesis:
    """Search down from the plain fit and up from the model, as far as needed, and return the best hypothesis.

    The pruned plain fit decides the order. If it has many parts, nearly everything is missing; adding effects one at a
    time would then fail, so only the downward result is extended. The exception is a first addition that already scores
    better. If a few parts, or parts of one kind, explain every joint, they are only reviewed. Otherwise both directions
    are searched.

    Args:
        search: Search at its first objective.
        first: That objective.
        plain: Plain fit.
        early: Result of a search upwards, if there is one.
        without: Names of moves to leave out.
    """
    down = search_down(search, plain, without)
    first_addition = None
    if is_large := len(drop.list_parts(down)) > MANY_PARTS * len(search.excited):
        there = search.current_round
        search.return_to(first)
        first_addition = add.add_first(search)
        is_ahead = first_addition.score < search.rescore(down).score
        search.return_to(there)
        if not is_ahead or search.rescore(down).score <= search.rescore(first_addition).score:
            return search_up(search, search.relinearise(down), without)
    elif not search.find_joints_above_floor(down) and is_simple(down):
        return review(search, apply_moves(search, down, ("merge_joints", "one_for_several"), without), without)
    up = early
    if up is None:
        search.return_to(first)
        up = search_up(search, search.null, without, down if is_explained(search, down) else None, first_addition)
    up, lower = search.rescore(up), search.rescore(down)
    is_far_ahead = lower.score.over(up.score) > AHEAD * search.null.score.over(up.score)
    if (is_large or is_far_ahead or is_explained(search, up)) and up.score <= lower.score:
        return search.relinearise(up) if early else up
    down = search_up(search, search.relinearise(down), without)
    up = search.rescore(up)
    search.report("up from the model", up)
    search.report("down from the plain fit", down)
    return min(up, down, key=lambda h: h.score)


def search_up(
    search: Search,
    h: Hypothesis,
    without: Container[str] = (),
    rival: Hypothesis | None = None,
    first_addition: Hypothesis | None = None,
) -> Hypothesis:
    """Add effects one at a time, apply the moves of a round after each, then review the result.

    Args:
        search: Search.
        h: Initial hypothesis.
        without: Names of moves to leave out.
        rival: Hypothesis that must be reached; the search ends when a round scores worse.
        first_addition: Result of the first addition, if it is known.
    """
    while len(h.effects) < MAX_EFFECTS * len(search.excited) and search.find_joints_above_floor(h):
        larger, first_addition = first_addition or add.apply(search, h), None
        if larger is h:
            break
        gained = search.null.score.over(h.score)
        h = apply_moves(search, search.relinearise(line_scan.apply(search, larger)), MOVES_AFTER_ADDITION, without)
        search.report("added", h)
        if is_stuck(search, h, gained) or (rival and h.score > search.rescore(rival).score):
            break
    return review(search, h, without)


def review(search: Search, h: Hypothesis, without: Container[str] = ()) -> Hypothesis:
    """Apply the moves of the review, then refine the result."""
    return refine(search, apply_moves(search, h, MOVES_OF_REVIEW, without), without)


def search_down(search: Search, plain: Hypothesis, without: Container[str] = ()) -> Hypothesis:
    """Write the plain fit as effects, and drop parts that are not worth their price."""
    search.say("  writing the plain fit as effects")
    description = convert_to_effects(search, plain)
    parameters = description.parameters(search.train.nominal.base)
    known = convert_columns(plain.fit, parameters)
    found = fit(search.task, parameters, parameters.initial_theta(plain.fit.factors), known, jacobian_refreshes=0)
    if found is None:
        return search.rescore(plain)
    named = search.relinearise(search.evaluate(description, found))
    search.report("  as effects", named)
    return apply_moves(search, named, ("share_value", "drop"), without)


def is_simple(h: Hypothesis) -> bool:
    """Whether a hypothesis has few parts, or parts of one kind only."""
    kinds = {part if isinstance(part, str) else part.name() for part in drop.list_parts(h)}
    return len(drop.list_parts(h)) <= FEW_PARTS or len(kinds) == 1


def is_explained(search: Search, h: Hypothesis) -> bool:
    """Whether the held-out error of every excited joint is near its noise floor."""
    return bool(search.floor_ratios(h)[find_excited_indices(search)].max() <= EXPLAINED)


def apply_moves(search: Search, h: Hypothesis, names: tuple[str, ...], without: Container[str]) -> Hypothesis:
    """Apply moves in order; a move without result is not repeated on the same hypothesis."""
    unchanged: dict[str, Hypothesis] = {}
    for name in names:
        if name not in without and unchanged.get(name) is not h:
            before, h = h, find_move(name)(search, h)
            if h is before or name == "drop":  # drop repeats itself until it finds nothing
                unchanged[name] = h
    return h


def refine(search: Search, h: Hypothesis, without: Container[str]) -> Hypothesis:
    """Fit, scan and restart while this improves the score much and an excited joint is far from explained.

    Wide play and strong friction are correlated, so that a fit needs more steps along their narrow valley than a
    comparison allows. Effects that compensated half-way are dropped at its end. This is skipped for many effects, where
    each fit takes minutes.
    """
    while 0 < len(h.effects) <= drop.MANY and line_scan.find_unexplained_joints(search, h):
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
        h = apply_moves(search, h, MOVES_OF_REVIEW, without)
        search.report("fitted on", h)
    return h


def is_stuck(search: Search, h: Hypothesis, gained_before: float) -> bool:
    """Whether a round gained little while every excited joint is far from explained.

    The missing effect is then not in the catalogue, or the search has passed it. More effects would only overfit.
    """
    gained = search.null.score.over(h.score)
    lost = set(line_scan.find_unexplained_joints(search, h)) == search.excited
    return lost and gained - gained_before < LITTLE * gained


def find_excited_indices(search: Search) -> list[int]:
    """Return the indices of the excited joints."""
    return [place for place, joint in enumerate(search.train.nominal.joints) if joint in search.excited]
