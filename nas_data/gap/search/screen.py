"""Screening: sort candidate effects by a first-order estimate of the loss, from one simulation each."""

import math
from collections.abc import Container, Hashable, Iterator, Mapping, MutableMapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from nas_data import registry
from nas_data.effects.base import Effect, Scales, find_effect, make_effect
from nas_data.errors import NasError
from nas_data.gap.nominal import Nominal
from nas_data.gap.search.constants import CORRELATION
from nas_data.gap.search.fit import MAX_STEP, Fit, solve_bounded
from nas_data.gap.search.objective import FitTask
from nas_data.gap.search.score import Score
from nas_data.gap.side_by_side import map_in_parallel
from nas_data.mjcf.arm_ends import list_arm_ends

STRETCH_BOUNDS = (0.0, 2.0)  # factor s on the change of positions at a guess, to first order
SIGNED_STRETCH_BOUNDS = (-6.0, 6.0)  # the same for a parameter with either sign
MIN_STRETCH = 0.2  # smallest factor with which a fit starts, so that it is not neutral
STEPS_PER_E = 3.0  # rounding steps per factor of e within which other values count as equal

Changes = MutableMapping[Hashable, np.ndarray]  # simulated changes of positions, by candidate and local state


@dataclass(frozen=True)
class Candidate:
    """An effect that may be missing, with its first-order estimate.

    Attributes:
        effect: Effect with estimated parameters.
        loss: First-order loss with the effect, all other parameters compensating.
        theta: First-order values of the other parameters, shape (size,).
    """

    effect: Effect
    loss: Score
    theta: np.ndarray

    @property
    def effect_key(self) -> tuple[str, str | None]:
        """Name and joint of the effect."""
        return self.effect.name(), self.effect.joint


def average_scales(sizes: Sequence[Scales]) -> Scales:
    """Return the mean scales of all joints, for effects of the whole arm."""
    numbers = [name for name in Scales.__dataclass_fields__ if not name.endswith("_servo")]
    means = {name: np.mean([getattr(s, name) for s in sizes]) for name in numbers}
    return replace(sizes[0], velocity_servo=False, position_servo=False, **means)


def generate_candidates(nominal: Nominal, sizes: Sequence[Scales]) -> Iterator[Effect]:
    """Yield every effect of the catalogue at every joint, or every arm, and initial guess."""
    mean, of_joint = average_scales(sizes), dict(zip(nominal.joints, sizes, strict=True))
    ends = list_arm_ends(nominal.spec, nominal.joints)
    arms = ends if len(ends) > 1 else ()
    for name in registry.list_names("effects"):
        kind = find_effect(name)
        places: list[str | None] = [*nominal.joints] if kind.per_joint else [*arms] if kind.per_link else []
        if kind.whole_arm and not (kind.per_link and arms):
            places.append(None)
        for joint in places:
            for values in kind.guesses(mean if joint is None else of_joint[joint]):
                given = [p for p in kind.parameters if p.name in values]
                clipped = {p.name: float(np.clip(values[p.name], p.low, p.high)) for p in given}
                yield make_effect(name, joint, clipped)


def screen(
    task: FitTask,
    state: Fit,
    sizes: Sequence[Scales],
    joints: Container[str],
    changes: Changes,
    names: Container[str] | None = None,
) -> list[Candidate]:
    """Return candidates to add to a fitted hypothesis, sorted by loss; one for each effect and joint.

    Args:
        task: Model and some episodes.
        state: Fitted hypothesis with predictions and Jacobian on these episodes.
        sizes: Scales of each joint.
        joints: Joints of the candidates.
        changes: Simulated changes on these episodes; new ones are added.
        names: Names of the candidates; all effects if None.
    """
    best: dict[tuple[str, str | None], Candidate] = {}
    present = {(effect.name(), effect.joint) for effect in state.effects}
    wanted = [
        effect
        for effect in generate_candidates(task.nominal, sizes)
        if (effect.name(), effect.joint) not in present
        and (effect.local_joint is None or effect.local_joint in joints)
        and (names is None or effect.name() in names)
    ]
    by_joint = {None: average_scales(sizes)} | dict(zip(task.nominal.joints, sizes, strict=True))
    identities = {effect: (effect, round_local_parameters(state, effect)) for effect in wanted}
    unknown = [effect for effect in wanted if identities[effect] not in changes]

    def simulate(group: Sequence[Effect]) -> None:
        for effect, change in simulate_changes(task, state, group):
            changes[identities[effect]] = change

    def estimated(effect: Effect) -> Candidate | None:
        vanishing_value = effect.vanishing_value(by_joint[effect.joint])
        if identities[effect] not in changes:
            return None
        return estimate_first_order(task, state, effect, vanishing_value, changes[identities[effect]])

    map_in_parallel(simulate, group_effects(task, unknown))
    for found in map_in_parallel(estimated, wanted):
        if found is not None and (found.effect_key not in best or found.loss < best[found.effect_key].loss):
            best[found.effect_key] = found
    return sorted(best.values(), key=lambda candidate: candidate.loss)


def round_local_parameters(state: Fit, effect: Effect) -> Hashable:
    """Return rounded parameters at an effect's joint, on which its change of positions mainly depends."""
    joint = effect.local_joint

    def near(name: str | None) -> bool:
        return joint is None or name is None or name == joint

    effects = [(o.name(), o.joint, *round_logs(vars(o))) for o in state.effects if near(o.local_joint)]
    free = {p.name: state.factors[p.name] for p in state.parameters.base if near(p.joint)}
    return (*effects, *round_logs(free))


def round_logs(values: Mapping[str, object]) -> Iterator[tuple[str, float]]:
    """Yield the rounded logarithms of values, by name."""
    for name, value in values.items():
        if isinstance(value, float):
            yield name, float(round(STEPS_PER_E * math.log(abs(value)))) if 0 < abs(value) < math.inf else value


def group_effects(task: FitTask, effects: Sequence[Effect]) -> list[list[Effect]]:
    """Return groups of effects of one kind that move different joints, as far as that is known.

    The effects of a group share a rollout, for example those of a robot's legs.
    """
    groups: list[tuple[list[Effect], np.ndarray]] = []
    for effect in effects:
        seen = task.moved_by_joint.get(effect.local_joint) if effect.local_joint else None
        if seen is None:
            groups.append(([effect], np.ones(len(task.floor), bool)))
            continue
        fitting = (g for g in groups if g[0][0].name() == effect.name() and not (g[1] & seen).any())
        if group := next(fitting, None):
            group[0].append(effect)
            group[1][:] |= seen
        else:
            groups.append(([effect], seen.copy()))
    return [group for group, _ in groups]


def simulate_changes(task: FitTask, state: Fit, group: Sequence[Effect]) -> Iterator[tuple[Effect, np.ndarray]]:
    """Yield each effect with its change of a hypothesis' positions at the guess [rad; m], shape (E, T, n).

    Effects that do not fit the model or make it diverge are left out.

    Args:
        task: Model and some episodes.
        state: Fitted hypothesis.
        group: Effects that move different joints.
    """
    try:
        predicted = task.rollout_model.predict(task.evidence, (*state.effects, *group), state.factors) + task.correction
    except NasError:
        if len(group) > 1:
            for effect in group:
                yield from simulate_changes(task, state, [effect])
        return
    change = np.asarray(predicted - state.predicted)
    for effect in group:
        yield effect, change if len(group) == 1 else change * task.moved_by_joint[effect.joint]


def estimate_first_order(
    task: FitTask, state: Fit, effect: Effect, vanishing_value: float, change: np.ndarray
) -> Candidate:
    """Estimate the loss with a candidate beside a hypothesis.

    To first order the candidate changes the positions by s · c, with its change c at the guess and a factor s. The
    other parameters change them by J Δθ. Both are solved together, with weights updated three times.

    Args:
        task: Model and some episodes.
        state: Fitted hypothesis.
        effect: Candidate at an initial guess.
        vanishing_value: Value of its first parameter at which it vanishes.
        change: Its change of the positions [rad; m], shape (E, T, n).
    """
    counts = task.evidence.mask[..., None]
    errors, starts = task.errors(state.predicted)
    (columns, start_columns) = task.absorb_change(np.concatenate([change[None], state.jacobian]))
    guess, start_columns = errors, start_columns.reshape(len(columns), -1)
    low, high = state.parameters.bounds()
    low, high = np.maximum(low - state.theta, -MAX_STEP), np.minimum(high - state.theta, MAX_STEP)
    prior = state.parameters.prior_weights(state.theta)
    shortest, longest = SIGNED_STRETCH_BOUNDS if is_signed(effect) else STRETCH_BOUNDS
    stretch = 1.0
    shift: np.ndarray = np.zeros(len(state.theta))
    for _ in range(3):
        squares = (guess**2).sum(1) / task.evidence.mask.sum(1)[:, None]
        weights = np.sqrt(task.evidence.period / CORRELATION / (task.tolerance + squares))[:, None] * counts
        rows = np.concatenate([(columns * weights).reshape(len(columns), -1), start_columns], axis=1)
        hessian = rows @ rows.T + np.diag([1e-9, *prior**2])
        gradient = rows @ np.concatenate([(errors * weights).ravel(), starts.ravel()])
        gradient += np.array([0.0, *(prior**2 * state.theta)])
        solved = solve_bounded(hessian, gradient, 0.0, np.array([shortest, *low]), np.array([longest, *high]))
        stretch, shift = float(solved[0]), solved[1:]
        guess = errors + np.tensordot(solved, columns, 1)
    squares = (guess**2).sum(1) / task.evidence.mask.sum(1)[:, None]
    misfit = float((0.5 * task.observations * np.log(task.tolerance + squares)).sum())
    misfit += float(0.5 * ((prior * (state.theta + shift)) ** 2).sum())
    misfit += float(0.5 * ((starts.ravel() + solved @ start_columns) ** 2).sum())
    return Candidate(
        stretch_effect(effect, stretch, vanishing_value), Score(misfit, task.objective), state.theta + shift
    )


def is_signed(effect: Effect) -> bool:
    """Whether the effect's first parameter has either sign."""
    return effect.parameters[0].low < 0


def stretch_effect(effect: Effect, stretch: float, vanishing_value: float) -> Effect:
    """Return an effect whose change of positions is s = `stretch` times as large, to first order."""
    if not is_signed(effect):
        stretch = max(stretch, MIN_STRETCH)
    values = {}
    for place, p in enumerate(effect.parameters):
        value = getattr(effect, p.name)
        if place == 0 and np.isinf(p.neutral):
            value = 1 / max(stretch / value + (1 - stretch) / vanishing_value, 1e-12)
        elif place == 0 or p.low < 0:
            value = p.neutral + stretch * (value - p.neutral)
        values[p.name] = value if value == p.neutral else float(np.clip(value, p.low, p.high))
    return make_effect(effect.name(), effect.joint, values)
