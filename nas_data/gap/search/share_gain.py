"""One gain for all servos of a plain fit."""

import math
from dataclasses import replace

from nas_data.effects.base import Effect, make_effect
from nas_data.gap.search.constants import SIMPLE_SIZE
from nas_data.gap.search.hypothesis import Hypothesis
from nas_data.gap.search.search import Search
from nas_data.gap.side_by_side import map_in_parallel

TORQUES = ("servo_damping", "damping", "limit", "armature", "frictionloss")  # parameters in proportion to a torque
TORQUE_EFFECTS = ("coulomb_friction", "viscous_friction", "rotor_inertia")


def share_gain(search: Search, plain: Hypothesis) -> Hypothesis:
    """Return a plain fit with one factor on the gains of all servos, if its score is better.

    Without gravity, a joint moves the same if its gain, damping, friction, inertia and limit are multiplied by one
    number. Recordings of an arm dominated by friction hardly determine that number joint by joint. Servos of one arm
    are usually equal, so that all joints together determine it. Each joint starts at the common gain, its other
    parameters scaled as its gain.
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
    factors = dict(plain.fit.factors)
    ratios = {joint: gain / factors[f"{joint}.gain"] for joint in joints}
    for name in plain.description.freed:
        joint, kind = name.rsplit(".", 1)
        if kind in TORQUES and joint in ratios:
            factors[name] *= ratios[joint]  # the fit clips it to its bounds
    effects = [scale_effect(effect, ratios.get(effect.joint or "", 1.0)) for effect in plain.effects]
    effects += [make_effect("servo_stiffness", joint, {"factor": gain}) for joint in joints]
    freed = frozenset(name for name in plain.description.freed if not name.endswith(".gain"))
    shared = plain.description.shared | {"servo_stiffness"}
    description = replace(plain.description, effects=tuple(effects), freed=freed, shared=shared)
    return search.fit_description(description, factors, steps=10, jacobian_refreshes=3)


def scale_effect(effect: Effect, ratio: float) -> Effect:
    """Return an effect whose first parameter is a torque multiplied by a ratio, within its bounds; others unchanged."""
    if effect.name() not in TORQUE_EFFECTS:
        return effect
    first = effect.parameters[0]
    value = min(max(float(getattr(effect, first.name)) * ratio, first.low), first.high)
    return make_effect(effect.name(), effect.joint, {first.name: value})
