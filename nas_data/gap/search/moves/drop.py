"""Drop effects and freed parameters that are not worth their price."""

import math

import numpy as np

from nas_data.count_of import count_of
from nas_data.effects.base import Effect
from nas_data.gap.nominal_parameters import NominalParameter, read_own_value
from nas_data.gap.search.constants import FAR_BEHIND, LARGE_SIZE, PRICE, SHORTLIST
from nas_data.gap.search.fit import MAX_STEP, compute_inverse_hessian
from nas_data.gap.search.hypothesis import Description, Hypothesis, compute_effect_price, effect_key
from nas_data.gap.search.parameters import FreeParameters
from nas_data.gap.search.plain_fit import EFFECT_OF_PARAMETER, convert_to_factor
from nas_data.gap.search.screen import average_scales
from nas_data.gap.search.search import Search
from nas_data.gap.search.torque_scale import leave_out
from nas_data.gap.side_by_side import map_in_parallel

Part = Effect | str


def apply(search: Search, h: Hypothesis) -> Hypothesis:
    """Drop parts of low saliency while the score falls; several at a time if there are many."""
    while list_parts(h):
        better = drop_several(search, h) if len(list_parts(h)) > LARGE_SIZE else h
        better = drop_one(search, h) if better is h else better
        if better is h:
            return h
        h = better
        search.report("dropped to", h)
    return h


def drop_one(search: Search, h: Hypothesis) -> Hypothesis:
    """Drop the effect or freed parameter without which the score is lowest, if it falls.

    Short fits compare the parts. If the score falls without several parts, dropping them together is tried. If it falls
    without none, the best is fitted to convergence first.
    """
    search.say(f"  dropping one of {count_of(len(list_parts(h)), 'part')}, if its likelihood gain is below its penalty")
    losses = estimate_losses(search, h)
    order = sorted(losses, key=lambda part: losses[part])[:SHORTLIST]
    doubted = [order[0], *(part for part in order[1:] if losses[part] < FAR_BEHIND)]  # estimates are inaccurate
    found = map_in_parallel(lambda part: fit_without(search, h, [part]), doubted)
    sound = {part: one for part, one in zip(doubted, found, strict=True) if one is not None and one.is_finite}
    if not sound:
        return h
    spare = [part for part, one in sound.items() if one.score < h.score]
    best = min(sound.values(), key=lambda one: one.score)
    if len(spare) > 1:
        together = fit_without(search, h, spare)
        if together is not None and together.is_finite and together.score < best.score:
            return together
    if not spare and best.description != Description():  # the model alone has converged already
        best = search.retry_if_chaotic(search.fit_further(best))
    return best if best.score < h.score else h


def drop_several(search: Search, h: Hypothesis) -> Hypothesis:
    """Drop all parts with a saliency below their price, or else half or a quarter of them."""
    losses = estimate_losses(search, h)
    spare = [part for part in sorted(losses, key=lambda p: losses[p]) if losses[part] < compute_part_price(part)]
    while len(spare) > 1:
        found = fit_without(search, h, spare)
        if found is not None and found.is_finite and found.score < h.score:
            return found
        spare = spare[: len(spare) // 2]
    return h


def list_parts(h: Hypothesis) -> list[Part]:
    """Return the effects and the names of the freed parameters."""
    return [*h.effects, *sorted(h.description.freed)]


def compute_part_price(part: Part) -> float:
    """Return the price of an effect or freed parameter [nats]."""
    return PRICE if isinstance(part, str) else compute_effect_price(part)


def fit_without(search: Search, h: Hypothesis, gone: list[Part]) -> Hypothesis | None:
    """Fit a hypothesis without some of its parts; None if the model diverges."""
    effects = tuple(effect for effect in h.effects if effect not in gone)
    left = {effect.name() for effect in effects}
    freed = h.description.freed - {part for part in gone if isinstance(part, str)}
    description = Description(effects, freed, h.description.shared & left)
    if description == Description():
        return search.null
    kept = {effect_key(effect) for effect in effects}
    followed, factors = compensate(search, h, gone)
    nearer = description.with_effects([effect for effect in followed if effect_key(effect) in kept])
    replacements = [found for part in gone if (found := find_replacement(search, h, part))]
    replaced = {parameter.name: factor for parameter, factor in replacements}
    starts = [(description, h.fit.factors), (nearer, factors), (description, {**h.fit.factors, **replaced})]
    if len(gone) == 1 and isinstance(gone[0], Effect):
        spec, number = search.train.nominal.spec, h.effects.index(gone[0])
        starts += filter(None, [leave_out(h.description, h.fit.factors, spec, number)])
    best = min(starts, key=lambda start: search.evaluate_loss(*start).nats)
    return search.fit_description(*best, h.fit, steps=4)


def find_replacement(search: Search, h: Hypothesis, part: Part) -> tuple[NominalParameter, float] | None:
    """Return the base parameter that is free without an effect and can stand for it, with its factor, if any."""
    found = None if isinstance(part, str) else convert_to_factor(search, part)
    return found if found and found[0].name not in h.fit.factors else None


def compensate(search: Search, h: Hypothesis, gone: list[Part]) -> tuple[tuple[Effect, ...], dict[str, float]]:
    """Return effects and factors without some parts, the other parameters compensating to first order.

    If the removed parameters change by δ, all change by H⁻¹ₐₖ [(H⁻¹)ₖₖ]⁻¹ δ (Hassibi and Stork, 1993).
    """
    parameters, theta = h.fit.parameters, h.fit.theta
    inverse = compute_inverse_hessian(search.task, h.fit)
    changes = {c: change for part in gone for c, change in compute_removal_steps(search, h, part).items()}
    columns = list(changes)
    multipliers = np.linalg.pinv(inverse[np.ix_(columns, columns)]) @ np.array(list(changes.values()))
    moved = theta + np.clip(inverse[:, columns] @ multipliers, -MAX_STEP, MAX_STEP)
    moved = np.clip(moved, *parameters.bounds())
    return parameters.effects_at(moved), parameters.factors_at(moved)


def compute_removal_steps(search: Search, h: Hypothesis, part: Part) -> dict[int, float]:
    """Return the changes of θ that remove a part, by index."""
    parameters, theta = h.fit.parameters, h.fit.theta
    if isinstance(part, str):
        return {c: -float(theta[c]) for c, label in enumerate(parameters.labels) if label == (part,)}
    number = h.effects.index(part)
    columns = [c for c, free in enumerate(parameters.effect_parameters) if number in free.effect_indices]
    return {column: compute_removal_step(search, parameters, theta, column) for column in columns}


def estimate_losses(search: Search, h: Hypothesis) -> dict[Part, float]:
    """Return the saliency of each part: the second-order increase of the loss without it [nats].

    With δ as in `compensate`, it is ½ δᵀ [(H⁻¹)ₖₖ]⁻¹ δ, H = JᵀWJ + prior (Hassibi and Stork, 1993). If a base parameter
    within its bounds can stand for the part, it is that parameter's prior.
    """
    inverse = compute_inverse_hessian(search.task, h.fit)

    def loss(part: Part) -> float:
        if found := find_replacement(search, h, part):
            parameter, factor = found
            return 0.5 * (math.log(factor) / parameter.deviation(math.log(factor))) ** 2
        changes = compute_removal_steps(search, h, part)
        columns, change = list(changes), np.array(list(changes.values()))
        return float(0.5 * change @ np.linalg.pinv(inverse[np.ix_(columns, columns)]) @ change) if columns else 0.0

    return {part: loss(part) for part in list_parts(h)}


def compute_removal_step(search: Search, parameters: FreeParameters, theta: np.ndarray, column: int) -> float:
    """Return the change of a parameter that removes its effect, to first order in the effect's size.

    An amount v = v₀ exp(θ) vanishes with Δθ = −1; a factor f returns to 1 with Δθ = −log f. A limit returns to the
    model's own, a floor to where it is not touched. If that is infinite, its derivative is that of its inverse, so
    Δθ = 1.
    """
    free = parameters.effect_parameters[column]
    value, neutral = free.value(float(theta[column])), free.parameter.neutral
    effect = parameters.effects[free.effect_indices[0]]
    if np.isinf(neutral) and effect.joint is not None and effect.name() in EFFECT_OF_PARAMETER:
        neutral = read_own_value(search.train.nominal.spec, effect.joint, EFFECT_OF_PARAMETER[effect.name()][0])
    if np.isinf(neutral) and effect.joint is None:
        neutral = effect.vanishing_value(average_scales(search.scales))
    if free.signed:
        return (neutral - value) / free.scale
    if np.isinf(neutral):
        return 1.0
    return float(np.log(neutral / value)) if neutral > 0 else -1.0
