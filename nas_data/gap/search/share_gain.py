"""One gain for all servos of a plain fit."""

import math
from dataclasses import replace

from nas_data.effects.base import make_effect
from nas_data.gap.search.constants import SIMPLE_SIZE
from nas_data.gap.search.hypothesis import Hypothesis
from nas_data.gap.search.search import Search
from nas_data.gap.search.torque_scale import scale_torques
from nas_data.gap.side_by_side import map_in_parallel


def share_gain(search: Search, plain: Hypothesis) -> Hypothesis:
    """Return a plain fit with one factor on the gains of all servos, if its score is better.

    Recordings of an arm dominated by friction hardly determine the size of all torques joint by joint. Servos of one
    arm are usually equal, so that all joints together determine it. Each joint starts at the common gain, its other
    torques scaled as its gain.
    """
    joints = [name.rsplit(".", 1)[0] for name in sorted(plain.description.freed) if name.endswith(".gain")]
    if min(len(joints), search.count_unexplained(plain)) < SIMPLE_SIZE:
        return plain
    logs = [math.log(plain.fit.factors[f"{joint}.gain"]) for joint in joints]
    starts = (math.exp(sum(logs) / len(logs)), 1.0)
    fitted = map_in_parallel(lambda gain: fit_with_gain(search, plain, joints, gain), starts)
    best = min(filter(None, fitted), key=lambda one: one.score, default=plain)
    return best if best.score < plain.score else plain


def fit_with_gain(search: Search, plain: Hypothesis, joints: list[str], gain: float) -> Hypothesis | None:
    """Fit one factor on the gains of some joints, from `gain`, and all other parameters; None if the model diverges."""
    ratios = {joint: gain / plain.fit.factors[f"{joint}.gain"] for joint in joints}
    description, factors = scale_torques(plain.description, plain.fit.factors, search.train.nominal.spec, ratios)
    gains = [make_effect("servo_stiffness", joint, {"factor": gain}) for joint in joints]
    freed = frozenset(name for name in description.freed if not name.endswith(".gain"))
    shared = description.shared | {"servo_stiffness"}
    description = replace(description, effects=(*description.effects, *gains), freed=freed, shared=shared)
    return search.fit_description(description, factors, steps=10, jacobian_refreshes=3)
