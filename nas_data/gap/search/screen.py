"""Order candidates by one simulation each: how much of the error would go, to first order, all else following."""

import math
from collections.abc import Container, Hashable, Iterator, Mapping, MutableMapping, Sequence
from dataclasses import dataclass

import numpy as np

from nas_data import registry
from nas_data.effects.base import Effect, Scales, find_effect, make_effect
from nas_data.errors import NasError
from nas_data.gap.search.fit import LONGEST_STEP, Fit, solve_bounded
from nas_data.gap.search.objective import CORRELATION, FitTask, Score
from nas_data.gap.side_by_side import side_by_side

STRETCHES = (0.0, 2.0)  # how far a guess may be stretched along its mark, to first order
SIGNED_STRETCHES = (-6.0, 6.0)  # the same where the parameter has either sign
SMALLEST_STRETCH = 0.2  # a fit starts no nearer to the neutral value than this share of the guess
ROUGHLY = 3.0  # steps to a factor of e in which a number beside a candidate counts as the same

Changes = MutableMapping[Hashable, np.ndarray]  # what candidates change beside what is known at their joint


@dataclass(frozen=True)
class Candidate:
    """An effect that may be missing, at a first guess.

    Attributes:
        effect: With guessed parameters.
        loss: First-order loss with the effect, all other numbers following.
        theta: The numbers of the hypothesis beside it where the first order puts them.
    """

    effect: Effect
    loss: Score
    theta: np.ndarray

    @property
    def place(self) -> tuple[str, str | None]:
        """Name and joint."""
        return self.effect.name(), self.effect.joint


def candidates(joints: Sequence[str], sizes: Sequence[Scales]) -> Iterator[Effect]:
    """Yield every effect of the catalogue at every joint, at its first guesses."""
    mean = Scales(*(float(np.mean([getattr(s, f) for s in sizes])) for f in Scales.__dataclass_fields__))
    for name in registry.names("effects"):
        kind = find_effect(name)
        places: list[tuple[str | None, Scales]] = [*zip(joints, sizes, strict=True)] if kind.per_joint else []
        places += [(None, mean)] if kind.whole_arm else []
        for joint, size in places:
            for values in kind.guesses(size):
                told = [p for p in kind.parameters if p.name in values]
                clipped = {p.name: float(np.clip(values[p.name], p.low, p.high)) for p in told}
                yield make_effect(name, joint, clipped)


def screen(
    task: FitTask,
    state: Fit,
    sizes: Sequence[Scales],
    joints: Container[str],
    changes: Changes,
    names: Container[str] | None = None,
) -> list[Candidate]:
    """Return candidates to add to a fitted hypothesis, the most promising first, each effect and joint once.

    Args:
        task: Some episodes are enough.
        state: Hypothesis fitted so far, with predictions and Jacobian on the same episodes.
        sizes: Natural sizes of each joint.
        joints: Joints to look at.
        changes: What was simulated before on the same episodes; what is simulated now is added.
        names: Effects to look at; all where None.
    """
    best: dict[tuple[str, str | None], Candidate] = {}
    present = {(effect.name(), effect.joint) for effect in state.effects}
    wanted = [
        effect
        for effect in candidates(task.nominal.joints, sizes)
        if (effect.name(), effect.joint) not in present
        and (effect.joint is None or effect.joint in joints)
        and (names is None or effect.name() in names)
    ]
    by_joint = dict(zip(task.nominal.joints, sizes, strict=True))
    identities = {effect: (effect, surroundings(state, effect)) for effect in wanted}
    unknown = [effect for effect in wanted if identities[effect] not in changes]

    def simulate(group: Sequence[Effect]) -> None:
        for effect, change in changes_of(task, state, group):
            changes[identities[effect]] = change

    def estimated(effect: Effect) -> Candidate | None:
        idle = effect.vanishing_value(by_joint[effect.joint]) if effect.joint else effect.parameters[0].neutral
        if identities[effect] not in changes:
            return None
        return first_order(task, state, effect, idle, changes[identities[effect]])

    side_by_side(simulate, group_effects(task, unknown))
    for found in side_by_side(estimated, wanted):
        if found is not None and (found.place not in best or found.loss < best[found.place].loss):
            best[found.place] = found
    return sorted(best.values(), key=lambda candidate: candidate.loss)


def surroundings(state: Fit, effect: Effect) -> Hashable:
    """Return what a hypothesis says of an effect's joint, roughly: what the effect changes depends on little else."""
    joint = effect.joint

    def near(name: str | None) -> bool:
        return joint is None or name is None or name == joint

    effects = [(o.name(), o.joint, *roughly(vars(o))) for o in state.effects if near(o.joint)]
    free = {p.name: state.factors[p.name] for p in state.parameters.base if near(p.joint)}
    return (*effects, *roughly(free))


def roughly(values: Mapping[str, object]) -> Iterator[tuple[str, float]]:
    """Yield the size of numbers by name, in steps."""
    for name, value in values.items():
        if isinstance(value, float):
            yield name, float(round(ROUGHLY * math.log(abs(value)))) if 0 < abs(value) < math.inf else value


def group_effects(task: FitTask, effects: Sequence[Effect]) -> list[list[Effect]]:
    """Return groups of one kind of effect of which no two move the same joint, as far as the task knows whom they move.

    Those of a group are simulated together, as those of a robot's legs are.
    """
    groups: list[tuple[list[Effect], np.ndarray]] = []
    for effect in effects:
        known = effect.joint and effect.distorts != "mass"  # which weighs on the joints that carry it
        seen = task.reach_of_joints.get(effect.joint) if known else None
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


def changes_of(task: FitTask, state: Fit, group: Sequence[Effect]) -> Iterator[tuple[Effect, np.ndarray]]:
    """Yield by how much each effect, at its first guess, moves the positions of a hypothesis [rad; m], shape (E, T, n).

    Effects that the model cannot take, or with which it diverges, are left out.

    Args:
        task: Some episodes.
        state: The hypothesis.
        group: Effects of which no two move the same joint.
    """
    try:
        predicted = task.rolled.predict(task.evidence, (*state.effects, *group), state.factors) + task.correction
    except NasError:
        if len(group) > 1:
            for effect in group:
                yield from changes_of(task, state, [effect])
        return
    change = np.asarray(predicted - state.predicted)
    for effect in group:
        yield effect, change if len(group) == 1 else change * task.reach_of_joints[effect.joint]


def first_order(task: FitTask, state: Fit, effect: Effect, idle: float, change: np.ndarray) -> Candidate:
    """Estimate what one candidate beside the state would leave.

    To first order the candidate changes the positions by s · c, where c is the change at its guess and s its stretch,
    and the other numbers by J · Δθ. Both are found together, with weights made anew for what they leave.

    Args:
        task: Some episodes.
        state: Hypothesis fitted so far.
        effect: Candidate at a first guess.
        idle: Value of its first parameter at which it ends to do anything.
        change: What it changes, shape (E, T, n).
    """
    counts = task.evidence.mask[..., None]
    errors = task.evidence.errors(state.predicted)
    guess = errors
    low, high = state.parameters.bounds()
    low, high = np.maximum(low - state.theta, -LONGEST_STEP), np.minimum(high - state.theta, LONGEST_STEP)
    prior = state.parameters.prior(state.theta)
    shortest, longest = SIGNED_STRETCHES if is_signed(effect) else STRETCHES
    stretch = 1.0
    shift: np.ndarray = np.zeros(len(state.theta))
    for _ in range(3):
        squares = (guess**2).sum(1) / task.evidence.mask.sum(1)[:, None]
        weights = np.sqrt(task.evidence.period / CORRELATION / (task.tolerated + squares))[:, None] * counts
        rows = np.concatenate([(change * weights)[None], state.jacobian * weights]).reshape(len(shift) + 1, -1)
        square = rows @ rows.T + np.diag([1e-9, *prior**2])
        pull = rows @ (errors * weights).ravel() + np.array([0.0, *(prior**2 * state.theta)])
        solved = solve_bounded(square, pull, 0.0, np.array([shortest, *low]), np.array([longest, *high]))
        stretch, shift = float(solved[0]), solved[1:]
        guess = (errors + stretch * change + np.tensordot(shift, state.jacobian, 1)) * counts
    squares = (guess**2).sum(1) / task.evidence.mask.sum(1)[:, None]
    misfit = float((0.5 * task.observations * np.log(task.tolerated + squares)).sum())
    misfit += float(0.5 * ((prior * (state.theta + shift)) ** 2).sum())
    return Candidate(stretch_effect(effect, stretch, idle), Score(misfit, task.objective), state.theta + shift)


def is_signed(effect: Effect) -> bool:
    """Whether the effect's size has either sign, around a neutral zero."""
    return effect.parameters[0].low < 0


def stretch_effect(effect: Effect, stretch: float, idle: float) -> Effect:
    """Return an effect whose mark is, to first order, `stretch` times as large; none where it is idle."""
    if not is_signed(effect):
        stretch = max(stretch, SMALLEST_STRETCH)
    values = {}
    for place, p in enumerate(effect.parameters):
        value = getattr(effect, p.name)
        if place == 0 and np.isinf(p.neutral):
            value = 1 / max(stretch / value + (1 - stretch) / idle, 1e-12)
        elif place == 0 or p.low < 0:
            value = p.neutral + stretch * (value - p.neutral)
        values[p.name] = float(np.clip(value, p.low, p.high))
    return make_effect(effect.name(), effect.joint, values)
