"""Fit again from the model's own parameters, because parameters distorted by a wrong effect keep it in place."""

from nas_data.gap.search.hypothesis import Hypothesis
from nas_data.gap.search.search import Search
from nas_data.gap.side_by_side import map_in_parallel


def apply(search: Search, h: Hypothesis) -> Hypothesis:
    """Fit all effects, and all but one, from the model's own parameters; keep the best."""
    tried = [h.description, *(h.description.without_effect(number) for number in range(len(h.effects)))]
    fitted = map_in_parallel(
        lambda each: search.fit_description(each, {}, jacobian_refreshes=1), [d for d in tried if d.effects]
    )
    return min([h, *filter(None, fitted)], key=lambda one: one.score)
