"""Replacement of friction effects without a significant size by firm friction of the model."""

from collections.abc import Mapping

import numpy as np

from nas_data.effects.base import Effect
from nas_data.gap.nominal import Nominal
from nas_data.gap.nominal_parameters import FIRM
from nas_data.gap.search.constants import PRICE
from nas_data.gap.search.fit import Fit, measure_jacobian
from nas_data.gap.search.hypothesis import Hypothesis, effect_key, reuse_jacobian
from nas_data.gap.search.search import Search

SMALLEST_IMPEDANCE = 1e-4  # of a friction constraint, in MuJoCo


def make_friction_firm(search: Search, kept: Hypothesis) -> tuple[Hypothesis, Mapping[str, float]]:
    """Replace friction effects whose size is not worth its price by firm friction of the model.

    Such an effect also stops the creep of its joint's friction, which may be all that it contributes. The search then
    continues with a model whose friction is firm, and no effect is named.

    Returns:
        The hypothesis without these effects, and the factors of `JOINT.solimpfriction`.
    """
    given, firm = search.train.nominal, dict[str, float]()
    kept = search.rescore(kept)
    for effect in kept.effects:
        if measure_firmness(given, effect) is None:
            continue
        before, train, name = search.current_round, search.train, f"{effect.joint}{FIRM}"
        more = measure_firmness(train.nominal, effect) or 1.0  # relative to the other effects of the joint
        search.make_friction_firm({name: more})
        other = leave_out(search, kept, effect)
        if other is not None and measure_loss(other) < measure_loss(kept) + PRICE:
            search.say(
                f"{effect.name()} at {effect.joint}: not needed, because the joint's firmer friction explains it"
            )
            kept, firm = other, {**firm, name: firm.get(name, 1.0) * more}
        else:
            search.train = train
            search.return_to(before)
            kept = search.rescore(kept)
    return kept, firm


def measure_firmness(nominal: Nominal, effect: Effect) -> float | None:
    """Return the impedance of the friction of an effect's joint over the model's; None if it changes nothing."""
    if effect.joint is None:
        return None
    spec = nominal.spec.copy()
    own, time = float(spec.joint(effect.joint).solimp_friction[0]), float(spec.joint(effect.joint).solref_friction[0])
    effect.edit(spec)
    friction = spec.joint(effect.joint)
    if friction.solimp_friction[0] <= own and friction.solref_friction[0] == time:
        return None
    return max(1.0, float(friction.solimp_friction[0]) / max(own, SMALLEST_IMPEDANCE))


def leave_out(search: Search, kept: Hypothesis, effect: Effect) -> Hypothesis | None:
    """Return a hypothesis without an effect and with all other values unchanged; None if it diverges."""
    number = [effect_key(each) for each in kept.effects].index(effect_key(effect))
    description = kept.description.without_effect(number)
    parameters = description.parameters(search.train.nominal.base)
    theta = parameters.initial_theta(kept.fit.factors)
    predicted = search.task.predict(parameters, theta)
    if predicted is None:
        return None
    known = reuse_jacobian(kept.fit, parameters)
    missing = [column for column in range(parameters.size) if column not in known]
    known |= dict(zip(missing, measure_jacobian(search.task, parameters, theta, predicted, missing), strict=True))
    jacobian = np.array([known[column] for column in range(parameters.size)]).reshape(-1, *predicted.shape)
    misfit = search.task.misfit(predicted)
    return search.evaluate(description, Fit(parameters, theta, predicted, misfit, jacobian, search.task.objective))


def measure_loss(h: Hypothesis) -> float:
    """Return the misfit of a hypothesis on fitted and held-out episodes [nats], at one tolerance."""
    return h.fit.misfit + h.heldout_misfit
