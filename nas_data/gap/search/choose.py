"""Strategy of the search: search up from the model and down from the plain fit, and keep the better score."""

from dataclasses import dataclass

from nas_data.gap.search.constants import (
    FAR_ABOVE,
    GAIN_SHARE,
    LARGE_SIZE,
    NEGLIGIBLE_GAIN,
    PARTS_PER_JOINT,
    SIMPLE_SIZE,
)
from nas_data.gap.search.fit import fit
from nas_data.gap.search.hypothesis import Hypothesis
from nas_data.gap.search.moves import add, drop, line_scan, restart
from nas_data.gap.search.moves.base import find_move
from nas_data.gap.search.plain_fit import add_limits, convert_columns, convert_to_effects, fit_smooth, refine_smooth
from nas_data.gap.search.search import Round, Search

MOVES_AFTER_ADDITION = ("swap", "shift_delay", "optional_parameters")  # after each addition
# when nothing is added any more
MOVES_OF_REVIEW = ("share_value", "simplify", "drop", "replace_by_rival", "shift_delay", "drop")


@dataclass(frozen=True)
class Choice:
    """Result of a search.

    Attributes:
        best: Hypothesis with the best score.
        plain: Plain fit.
        plain_fine: Whether the plain fit assumes finer physics steps than the model's own.
    """

    best: Hypothesis
    plain: Hypothesis
    plain_fine: bool


def choose(search: Search) -> Choice:
    """Search in both directions.

    If the smooth fit leaves few joints unexplained, effects are added to the model first. If they explain every joint,
    the search ends, and the plain fit is only completed as a baseline. The smooth fit is refined before that only where
    it nearly explains every joint, else after.
    """
    first = search.current_round
    if not search.find_joints_above_floor(search.null):
        return Choice(search.null, search.null, search.task.fine)
    plain = fit_smooth(search)
    if is_near := bool(search.floor_ratios(plain).max() <= FAR_ABOVE):
        plain = refine_smooth(search, plain)
    there, early = search.current_round, None
    finished: Round | None = None
    if 0 < search.count_unexplained(plain) <= SIMPLE_SIZE:
        search.return_to(first)
        early = search_up(search, search.null)
        if not is_explained(search, early):
            early = search.relinearise(early)  # its last drop may have left it unconverged
        free = search.rescore(plain)
        if is_explained(search, early) and early.score < free.fit.loss + free.heldout_misfit:
            finished = search.current_round
        search.return_to(there)
    if not is_near:
        plain = refine_smooth(search, plain)
    plain = add_limits(search, plain)
    fine = search.task.fine
    if early and finished:
        search.return_to(finished)
        return Choice(early, plain, fine)
    search.return_to(first)
    return Choice(search_both(search, first, plain, early), plain, fine)


def search_both(search: Search, first: Round, plain: Hypothesis, early: Hypothesis | None) -> Hypothesis:
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
    """
    down = search_down(search, plain)
    first_addition = None
    if is_large := len(drop.list_parts(down)) > PARTS_PER_JOINT * len(search.excited):
        there = search.current_round
        search.return_to(first)
        first_addition = add.add_first(search)
        is_ahead = first_addition.score < search.rescore(down).score
        search.return_to(there)
        if not is_ahead or search.rescore(down).score <= search.rescore(first_addition).score:
            return search_up(search, search.relinearise(down))
    elif not search.find_joints_above_floor(down) and is_simple(down):
        return review(search, down)
    up = early
    if up is None:
        search.return_to(first)
        up = search_up(search, search.null, down if is_explained(search, down) else None, first_addition)
    up, lower = search.rescore(up), search.rescore(down)
    is_far_ahead = lower.score.over(up.score) > GAIN_SHARE * search.null.score.over(up.score)
    if (is_large or is_far_ahead or is_explained(search, up)) and up.score <= lower.score:
        return search.relinearise(up) if early else up
    down = search_up(search, search.relinearise(down))
    up = search.rescore(up)
    search.report("up from the model", up)
    search.report("down from the plain fit", down)
    return min(up, down, key=lambda h: h.score)


def search_up(
    search: Search,
    h: Hypothesis,
    rival: Hypothesis | None = None,
    first_addition: Hypothesis | None = None,
) -> Hypothesis:
    """Add effects one at a time, apply the moves of a round after each, then review the result.

    Args:
        search: Search.
        h: Initial hypothesis.
        rival: Hypothesis that must be reached; the search ends when a round scores worse.
        first_addition: Result of the first addition, if it is known.
    """
    while search.find_joints_above_floor(h):
        larger, first_addition = first_addition or add.apply(search, h), None
        if larger is h:
            break
        if len(larger.effects) > len(h.effects) + 1:
            larger = drop.drop_several(search, larger)
        gained = search.null.score.over(h.score)
        h = apply_moves(search, search.relinearise(line_scan.apply(search, larger)), MOVES_AFTER_ADDITION)
        search.report("added", h)
        if is_stuck(search, h, gained) or (rival and h.score > search.rescore(rival).score):
            break
    return review(search, h)


def review(search: Search, h: Hypothesis) -> Hypothesis:
    """Apply the moves of the review, then refine the result."""
    return refine(search, apply_moves(search, h, MOVES_OF_REVIEW))


def search_down(search: Search, plain: Hypothesis) -> Hypothesis:
    """Write the plain fit as effects, and drop parts that are not worth their price."""
    search.say("  converting the plain fit to effects")
    description = convert_to_effects(search, plain)
    parameters = description.parameters(search.train.nominal.base)
    known = convert_columns(plain.fit, parameters)
    found = fit(search.task, parameters, parameters.initial_theta(plain.fit.factors), known, jacobian_refreshes=0)
    if found is None:
        return search.rescore(plain)
    named = search.relinearise(search.evaluate(description, found))
    search.report("  plain fit as effects", named)
    return apply_moves(search, named, ("share_value", "drop"))


def is_simple(h: Hypothesis) -> bool:
    """Whether a hypothesis has few parts, or parts of one kind only."""
    kinds = {part if isinstance(part, str) else part.name() for part in drop.list_parts(h)}
    return len(drop.list_parts(h)) <= SIMPLE_SIZE or len(kinds) == 1


def is_explained(search: Search, h: Hypothesis) -> bool:
    """Whether the held-out error of every excited joint is near its noise floor."""
    return search.count_unexplained(h) == 0


def apply_moves(search: Search, h: Hypothesis, names: tuple[str, ...]) -> Hypothesis:
    """Apply moves in order; a move without result is not repeated on the same hypothesis."""
    unchanged: dict[str, Hypothesis] = {}
    for name in names:
        if unchanged.get(name) is not h:
            before, h = h, find_move(name)(search, h)
            if h is before or name == "drop":  # drop repeats itself until it finds nothing
                unchanged[name] = h
    return h


def refine(search: Search, h: Hypothesis) -> Hypothesis:
    """Fit, scan and restart while this improves the score much and an excited joint is far from explained.

    Wide play and strong friction are correlated, so that a fit needs more steps along their narrow valley than a
    comparison allows. Effects that compensated half-way are dropped at its end. This is skipped for many effects, where
    each fit takes minutes.
    """
    while 0 < len(h.effects) <= LARGE_SIZE and line_scan.find_joints_far_above(search, h):
        before = search.null.score.over(h.score)
        h = search.relinearise(line_scan.apply(search, h))
        better = restart.apply(search, h)
        if better is h:
            better = line_scan.scan_parameters(search, h, anyway=True)
        if better is not h:
            h = search.relinearise(better)
        gained = search.null.score.over(h.score)
        if gained - before < NEGLIGIBLE_GAIN * gained:
            break
        h = apply_moves(search, h, MOVES_OF_REVIEW)
        search.report("fitted on", h)
    return h


def is_stuck(search: Search, h: Hypothesis, gained_before: float) -> bool:
    """Whether a round gained little while every excited joint is far from explained.

    The missing effect is then not in the catalogue, or the search has passed it. More effects would only overfit.
    """
    gained = search.null.score.over(h.score)
    lost = set(line_scan.find_joints_far_above(search, h)) == search.excited
    return lost and gained - gained_before < NEGLIGIBLE_GAIN * gained
