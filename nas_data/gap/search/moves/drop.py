"""Drop what the data do not need: effects and freed parameters of the model that are not worth their price."""

import numpy as np

from nas_data.effects.base import Effect
from nas_data.gap.search.fit import LONGEST_STEP, normal_equations
from nas_data.gap.search.hypothesis import PRICE, Description, Hypothesis, effect_cost, key
from nas_data.gap.search.parameters import SIGNED_SCALE, FreeParameters
from nas_data.gap.search.search import FAR_BEHIND, Search
from nas_data.gap.side_by_side import side_by_side

TRIED = 6  # without which the rest is fitted, of what seems to be worth least
MANY = 8  # effects beyond which several are dropped at a time

Part = Effect | str


def apply(search: Search, h: Hypothesis) -> Hypothesis:
    """Drop what seems to be worth least as long as the score falls; several at a time where there are many."""
    while parts(h):
        better = drop_several(search, h) if len(parts(h)) > MANY else h
        better = drop_one(search, h) if better is h else better
        if better is h:
            return h
        h = better
        search.report("dropped to", h)
    return h


def drop_one(search: Search, h: Hypothesis) -> Hypothesis:
    """Drop one effect or freed parameter, the one without which the score is lowest, if it falls.

    Short fits tell which. All without which alone the score falls are dropped together where that is better yet; where
    it falls without none, the best is fitted to its end before it is given up, and where episodes begin in motion it is
    given initial velocities of its own.
    """
    search.say(f"  dropping one of {len(parts(h))} parts, if one is not worth its price")
    losses = estimate_losses(search, h)
    order = sorted(losses, key=lambda part: losses[part])[:TRIED]
    doubted = [order[0], *(part for part in order[1:] if losses[part] < FAR_BEHIND)]  # an estimate may be far off
    found = side_by_side(lambda part: fit_without(search, h, [part]), doubted)
    sound = {part: one for part, one in zip(doubted, found, strict=True) if one is not None and one.is_sound}
    if not sound:
        return h
    spare = [part for part, one in sound.items() if one.score < h.score]
    best = min(sound.values(), key=lambda one: one.score)
    if len(spare) > 1:
        together = fit_without(search, h, spare)
        if together is not None and together.is_sound and together.score < best.score:
            return together
    if not spare and best.description != Description():  # the model alone was fitted to its end
        best = search.continued(best)
    if best.score < h.score:
        return best
    near = best.score.over(h.score) < FAR_BEHIND and search.begins_in_motion
    return search.relinearise(best) if near and search.with_own_start(best).score < h.score else h


def drop_several(search: Search, h: Hypothesis) -> Hypothesis:
    """Drop all parts that seem to be worth less than their price, or half of them, or a quarter."""
    losses = estimate_losses(search, h)
    spare = [part for part in sorted(losses, key=lambda p: losses[p]) if losses[part] < price(part)]
    while len(spare) > 1:
        found = fit_without(search, h, spare)
        if found is not None and found.is_sound and found.score < h.score:
            return found
        spare = spare[: len(spare) // 2]
    return h


def parts(h: Hypothesis) -> list[Part]:
    """Return the effects and the names of the freed parameters."""
    return [*h.effects, *sorted(h.description.freed)]


def joint_of(part: Part) -> str | None:
    """Return the joint of an effect or of a freed parameter; None for an effect of the arm."""
    return part.rsplit(".", 1)[0] if isinstance(part, str) else part.joint


def price(part: Part) -> float:
    """Return what an effect or a freed parameter must bring [nats]."""
    return PRICE if isinstance(part, str) else effect_cost(part)


def fit_without(search: Search, h: Hypothesis, gone: list[Part]) -> Hypothesis | None:
    """Return the hypothesis without some of its parts, fitted anew."""
    effects = tuple(effect for effect in h.effects if effect not in gone)
    left = {effect.name() for effect in effects}
    freed = h.description.freed - {part for part in gone if isinstance(part, str)}
    description = Description(effects, freed, h.description.shared & left)
    if description == Description():
        return search.null
    kept = {key(effect) for effect in effects}
    followed, factors = compensate(search, h, gone)
    nearer = description.with_effects([effect for effect in followed if key(effect) in kept])
    starts = [(description, h.fit.factors), (nearer, factors)]
    best = min(starts, key=lambda start: search.loss_at(*start).nats)
    return search.fitted(*best, h.fit, steps=4)


def compensate(search: Search, h: Hypothesis, gone: list[Part]) -> tuple[tuple[Effect, ...], dict[str, float]]:
    """Return all effects and factors when some parts go and the other numbers follow, to first order.

    The numbers of the parts change by δ, all by H⁻¹ₐₖ [(H⁻¹)ₖₖ]⁻¹ δ (Hassibi and Stork, 1993).
    """
    parameters, theta = h.fit.parameters, h.fit.theta
    inverse = inverse_hessian(search, h)
    changes = {c: change for part in gone for c, change in removal_of(h, part).items()}
    columns = list(changes)
    pull = np.linalg.pinv(inverse[np.ix_(columns, columns)]) @ np.array(list(changes.values()))
    moved = theta + np.clip(inverse[:, columns] @ pull, -LONGEST_STEP, LONGEST_STEP)
    moved = np.clip(moved, *parameters.bounds())
    return parameters.effects_at(moved), parameters.factors_at(moved)


def inverse_hessian(search: Search, h: Hypothesis) -> np.ndarray:
    """Return (JᵀWJ + prior)⁻¹ of a hypothesis, shape (size, size)."""
    parameters, theta = h.fit.parameters, h.fit.theta
    square, _ = normal_equations(search.sub, h.fit.predicted, h.fit.jacobian)
    return np.asarray(np.linalg.pinv(square + np.diag(parameters.prior(theta) ** 2) + 1e-9 * np.eye(len(theta))))


def removal_of(h: Hypothesis, part: Part) -> dict[int, float]:
    """Return by how much the numbers of a part change when it goes, by index."""
    parameters, theta = h.fit.parameters, h.fit.theta
    if isinstance(part, str):
        return {c: -float(theta[c]) for c, label in enumerate(parameters.labels) if label == (part,)}
    number = h.effects.index(part)
    columns = [c for c, free in enumerate(parameters.of_effects) if number in free.places]
    return {column: removal(parameters, theta, column) for column in columns}


def estimate_losses(search: Search, h: Hypothesis) -> dict[Part, float]:
    """Return by how many nats the loss rises without each part, to second order (Hassibi and Stork, 1993).

    Without it a number changes by δ, and the others follow: ½ δᵀ [(H⁻¹)ₖₖ]⁻¹ δ, with H = Jᵀ W J + prior.
    """
    inverse = inverse_hessian(search, h)

    def loss(part: Part) -> float:
        changes = removal_of(h, part)
        columns, change = list(changes), np.array(list(changes.values()))
        return float(0.5 * change @ np.linalg.pinv(inverse[np.ix_(columns, columns)]) @ change) if columns else 0.0

    return {part: loss(part) for part in parts(h)}


def removal(parameters: FreeParameters, theta: np.ndarray, column: int) -> float:
    """Return the change of a number that takes its effect away, to first order in the effect's size.

    What is proportional to a value v = v₀ exp(θ) goes with Δθ = −1; a factor f returns to 1 with Δθ = −log f; a limit
    that is lifted stays a limit to first order, so that its derivative is taken as that of its inverse.
    """
    free = parameters.of_effects[column]
    value, neutral = free.value(float(theta[column])), free.parameter.neutral
    if free.signed:
        return (neutral - value) / SIGNED_SCALE
    if np.isinf(neutral):
        return 1.0
    return float(np.log(neutral / value)) if neutral > 0 else -1.0
