"""Put one effect in the place of several parts: what one cause does, smooth parameters may do together."""

from nas_data.gap.search.hypothesis import Description, Hypothesis
from nas_data.gap.search.moves.add import beside
from nas_data.gap.search.moves.drop import joint_of, parts
from nas_data.gap.search.screen import Candidate
from nas_data.gap.search.search import FAR_BEHIND, TRIED, Search
from nas_data.gap.side_by_side import side_by_side


def apply(search: Search, h: Hypothesis) -> Hypothesis:
    """Try single effects in the place of all parts of a joint, then of all parts there are."""
    joints = [joint_of(part) for part in parts(h)]
    several: list[str | None] = [j for j in dict.fromkeys(joints) if j is not None and joints.count(j) > 1]
    for joint in [*several, None] if len(joints) > 1 else []:
        better = replace_parts(search, h, joint)
        if better is not h:
            return apply(search, better)
    return h


def replace_parts(search: Search, h: Hypothesis, joint: str | None) -> Hypothesis:
    """Try effects of one joint in the place of all its parts, or effects of the arm in the place of everything."""
    kept = [part for part in parts(h) if joint is not None and joint_of(part) != joint]
    effects = tuple(effect for effect in h.effects if effect in kept)
    left = {effect.name() for effect in effects}
    freed = frozenset(part for part in kept if isinstance(part, str))
    description = Description(effects, freed, h.description.shared & left)
    rest = search.fitted(description, h.fit.factors, h.fit, steps=4) if kept else search.null
    if rest is None:
        return h
    found, reach = search.screened(rest.fit, h, {joint} if joint else set())
    near = [c for c in found if c.effect.joint == joint and c.loss.over(reach) < FAR_BEHIND][:TRIED]

    def fit_instead(candidate: Candidate) -> Hypothesis | None:
        factors = rest.fit.parameters.factors_at(candidate.theta)
        return search.fitted(beside(rest, rest.fit, candidate), factors, rest.fit, jacobian_refreshes=1)

    fitted = [one for one in side_by_side(fit_instead, near) if one is not None and one.is_sound]
    best = min(fitted, key=lambda one: one.score, default=h)
    if best.score < h.score:
        search.report(f"one effect for all of {joint or 'the arm'}", best)
        return best
    return h
