"""Replace several parts by one effect, because several smooth parameters may compensate for one cause."""

from nas_data.gap.search.constants import FAR_BEHIND, GAIN_SHARE, MAX_ALTERNATIVES
from nas_data.gap.search.hypothesis import Description, Hypothesis
from nas_data.gap.search.moves.add import add_candidate
from nas_data.gap.search.moves.drop import find_part_joint, list_parts
from nas_data.gap.search.screen import Candidate
from nas_data.gap.search.search import Search
from nas_data.gap.side_by_side import map_in_parallel


def apply(search: Search, h: Hypothesis) -> Hypothesis:
    """Try single effects in place of all parts of a joint, then in place of all parts."""
    joints = [find_part_joint(part) for part in list_parts(h)]
    several: list[str | None] = [j for j in dict.fromkeys(joints) if j is not None and joints.count(j) > 1]
    for joint in [*several, None] if len(joints) > 1 else []:
        better = replace_parts(search, h, joint)
        if better is not h:
            return apply(search, better)
    return h


def replace_parts(search: Search, h: Hypothesis, joint: str | None) -> Hypothesis:
    """Try effects of one joint in place of all its parts, or effects of the arm in place of all parts."""
    kept = [part for part in list_parts(h) if joint is not None and find_part_joint(part) != joint]
    effects = tuple(effect for effect in h.effects if effect in kept)
    left = {effect.name() for effect in effects}
    freed = frozenset(part for part in kept if isinstance(part, str))
    description = Description(effects, freed, h.description.shared & left)
    rest = search.fit_description(description, h.fit.factors, h.fit, steps=4) if kept else search.null
    if rest is None:
        return h
    found, kept_loss = search.screen_candidates(rest.fit, h, {joint} if joint else set())
    far = max(FAR_BEHIND, GAIN_SHARE * rest.score.over(h.score))
    near = [c for c in found if c.effect.joint == joint and c.loss.over(kept_loss) < far][:MAX_ALTERNATIVES]

    def fit_instead(candidate: Candidate) -> Hypothesis | None:
        factors = rest.fit.parameters.factors_at(candidate.theta)
        return search.fit_description(add_candidate(rest, rest.fit, candidate), factors, rest.fit, jacobian_refreshes=1)

    fitted = [one for one in map_in_parallel(fit_instead, near) if one is not None and one.is_finite]
    best = min(fitted, key=lambda one: one.score, default=h)
    if best is not h and 0 <= best.score.over(h.score) < FAR_BEHIND:
        best = search.fit_further(best)
    if best.score < h.score:
        search.report(f"one effect for all of {joint or 'the arm'}", best)
        return best
    return h
