"""Free optional parameters of effects, such as the position of a payload."""

from collections.abc import Iterator

from nas_data.effects.base import Effect
from nas_data.gap.search.hypothesis import Description, Hypothesis, effect_key
from nas_data.gap.search.search import Search


def apply(search: Search, h: Hypothesis) -> Hypothesis:
    """Fit the optional parameters of each effect, and keep them if they are worth their price."""
    for key in [effect_key(effect) for effect in h.effects]:
        starts = list(free_optional_parameters(search, h, key))
        fitted = [search.fit_description(start, h.fit.factors, h.fit, jacobian_refreshes=1) for start in starts]
        best = min((one for one in fitted if one), key=lambda one: one.score, default=h)
        if best.score < h.score:
            search.report("  with optional parameters", best)
            h = best
    return h


def free_optional_parameters(search: Search, h: Hypothesis, key: tuple[str, str | None]) -> Iterator[Description]:
    """Yield the descriptions in which an effect has its optional parameters.

    It may need them at a joint above its floor. At any joint they may make another effect unnecessary: play with
    yielding stops is rigid play and a spring.
    """
    effect = next((one for one in h.effects if effect_key(one) == key), None)
    if effect is None:
        return
    alike = {effect_key(one) for one in h.effects if one.name() in h.description.shared & {effect.name()}} | {key}

    def free(one: Effect) -> Effect:
        scales = search.find_scales(one.joint) if one.joint else None
        return one.with_optional_parameters(scales) if effect_key(one) in alike else one

    freed = h.description.with_effects([free(one) for one in h.effects])
    if freed.effects == h.effects:
        return
    own = effect.local_joint
    if own is None or len(alike) > 1 or own in search.find_joints_above_floor(h):
        yield freed
    for number, other in enumerate(h.effects):
        if own and other.joint == own and other.name() in effect.confused_with:
            yield freed.without_effect(number)
