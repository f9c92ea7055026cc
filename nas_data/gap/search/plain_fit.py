"""The plain fit: every smooth parameter of every joint at once, with no name given, as anyone would fit them."""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from nas_data.effects.base import Effect, Scales, find_effect, make_effect
from nas_data.effects.edits.servo import stiffness
from nas_data.effects.joint_offset import JointOffset
from nas_data.gap.episode_batch import windows
from nas_data.gap.nominal_parameters import MAX_LOG_CHANGE, own_value
from nas_data.gap.search.fit import Fit, fit, is_loose, joint_of_label, reach_of_joints
from nas_data.gap.search.hypothesis import PRICE, Description, Hypothesis, reuse_jacobian
from nas_data.gap.search.objective import FitTask
from nas_data.gap.search.parameters import FreeParameters, Label
from nas_data.gap.search.screen import screen
from nas_data.gap.search.search import AT_FLOOR, TRIED, Search
from nas_data.gap.side_by_side import side_by_side

SHORT = 1.0  # [s] of the windows on which the fit begins: in open loop a wrong model soon is nowhere
SHORT_STEPS = 8_000  # physics steps that one rollout of them may take
FACTORS = (1.0, 0.3, 0.1, 0.03)  # of all gains, from which the fit may begin; of all filters the first and the last
CLEARLY = 0.1  # nats an observation (10 % of the errors) by which a start must do better than the model as it is
NEARLY = 0.3  # nats an observation by which a start may do worse than the best and still be followed
SMALL = 0.1  # of a joint's natural size, from which what the model lacks begins
FACTOR, ADDED, LOWERED = "factor", "added", "lowered"
NAMED = {  # effects that say what a freed parameter does: its kind, and what their value is
    "servo_stiffness": ("gain", FACTOR),
    "servo_damping": ("servo_damping", FACTOR),
    "torque_limit": ("limit", LOWERED),
    "viscous_friction": ("damping", ADDED),
    "rotor_inertia": ("armature", ADDED),
    "coulomb_friction": ("frictionloss", ADDED),
}
LIMITS = ("torque_limit", "command_delay")  # which an ordinary fit has besides


def fit_plain(search: Search) -> Hypothesis:
    """Fit gain, damping, rotor inertia, dry and viscous friction, offset and filters of every joint above the floor.

    A joint that is at the noise floor with its parameters a few percent off stays so: more freedom would fit noise.
    The fit begins on short windows and from several gains, and ends on the episodes of the search. Torque limits and a
    delay of the arm are tried last. The search goes on with the objective of the fit.
    """
    joints = search.above_floor(search.null)
    if not joints:
        return search.null
    description = describe(search, joints)
    parameters = description.parameters(search.train.nominal.base)
    count = f"{parameters.size} numbers of {len(joints)} joints"
    search.say(f"plain fit: {count}, on windows of {SHORT:g} s")
    found = begin_on_short_windows(search, description)
    search.say(f"plain fit: {count}, on the episodes of the search")
    if not found:  # the model is near, and what moves which joint stays as it is there
        base = Description().parameters(search.train.nominal.base)
        search.sub = replace(search.sub, reach_of_joints=reach_of_joints(search.sub, base))
    start = found.theta if found else parameters.start(search.null.fit.factors)
    known = {} if found else reuse_jacobian(search.null.fit, parameters, len(description.effects))
    known = {column: rows for column, rows in known.items() if not is_loose(parameters, column)}
    whole = fit(search.sub, parameters, start, known, steps=8, jacobian_refreshes=2)
    if whole is None:
        return search.null
    plain = search.judge(description, whole)
    if search.ratio(plain).max() > AT_FLOOR:
        plain = search.relinearise(plain)
    search.report("plain fit", plain)
    better = add_limits(search, plain) if search.ratio(plain).max() > AT_FLOOR else plain
    if better is not plain:
        search.report("plain fit with limits", better)
    return better


def describe(search: Search, joints: Collection[str]) -> Description:
    """Return the plain fit's description: what the model has in some joints is freed, what it lacks is added."""
    nominal, spec = search.train.nominal, search.train.nominal.spec
    freed = frozenset(p.name for p in nominal.base if p.kind != "mass" and p.joint in joints)
    effects: list[Effect] = []
    for joint in filter(joints.__contains__, nominal.joints):
        sizes = search.sizes[nominal.joints.index(joint)]
        lacking = {
            "coulomb_friction": ("torque", SMALL * sizes.torque, float(spec.joint(joint).frictionloss)),
            "viscous_friction": ("coefficient", SMALL * natural_damping(sizes), float(spec.joint(joint).damping[0])),
            "rotor_inertia": ("inertia", SMALL * sizes.inertia, float(spec.joint(joint).armature)),
        }
        effects += [make_effect(name, joint, {key: size}) for name, (key, size, own) in lacking.items() if own == 0]
        if stiffness(spec, joint) > 0:
            effects.append(make_effect("joint_offset", joint, {"offset": 1e-6}))
    return Description(tuple(effects), freed)


def natural_damping(sizes: Scales) -> float:
    """Return a joint's large torque over its large speed [N·m·s/rad], or its damping where that is more."""
    return max(sizes.damping, sizes.torque / sizes.speed)


def begin_on_short_windows(search: Search, description: Description) -> Fit | None:
    """Return the fit to short windows from the best of several starts; None where none clearly beats the model."""
    nominal = search.train.nominal
    rows = SHORT_STEPS // nominal.simulator().substeps
    evidence = windows(search.train.evidence, rows, SHORT)
    parameters = description.parameters(nominal.base)
    task = FitTask(nominal, evidence, search.train.floor, fine=False)
    starts = [parameters.start(factors) for factors in starting_factors(description.freed)]
    predicted = [task.predict(parameters, start) for start in starts]
    starts.append(mix_starts(task, parameters, starts, predicted))
    predicted.append(task.predict(parameters, starts[-1]))
    observation = float(task.observations.sum()) * len(task.floor)
    misfits = np.array([task.misfit(rows) for rows in predicted]) / observation
    order = np.argsort(misfits)
    if not misfits[order[0]] < misfits[0] - CLEARLY:
        return None
    best = [starts[number] for number in order[:TRIED] if misfits[number] < misfits[order[0]] + NEARLY]
    first = task.relinearise(parameters, best[0])
    fitted = side_by_side(lambda theta: fit(first, parameters, theta, steps=4, jacobian_refreshes=1), best)
    found = min(filter(None, fitted), key=lambda one: one.loss)
    task = task.relinearise(parameters, found.theta)
    return fit(task, parameters, found.theta, steps=6, jacobian_refreshes=2) or found


def mix_starts(
    task: FitTask, parameters: FreeParameters, starts: Sequence[np.ndarray], predicted: Sequence[np.ndarray | None]
) -> np.ndarray:
    """Return numbers that each joint takes from the start that suits it best."""
    far = np.full(len(task.floor), np.inf)
    errors = [far if rows is None else task.misfits(rows).sum(0) for rows in predicted]
    best = dict(zip(task.nominal.joints, np.argmin(errors, axis=0), strict=True))
    joints = [joint_of_label(label) for label in parameters.labels]
    return np.array([starts[best.get(joint or "", 0)][column] for column, joint in enumerate(joints)])


def starting_factors(freed: frozenset[str]) -> Sequence[dict[str, float]]:
    """Return factors of gains, of the servos' damping and of filters from which the fit may begin."""
    gains = FACTORS if any(name.endswith(".gain") for name in freed) else (1.0,)
    dampings = (0.0, 0.5, 1.0) if any(name.endswith(".servo_damping") for name in freed) else (0.0,)  # as powers of it
    filters = (FACTORS[0], FACTORS[-1]) if any(name.endswith(".filter") for name in freed) else (1.0,)
    made = []
    for gain, power, filtered in product(gains, dampings, filters):
        kinds = {"gain": gain, "servo_damping": gain**power, "filter": filtered}
        factors = {name: kinds[kind] for name in freed if (kind := name.rsplit(".", 1)[1]) in kinds}
        if factors not in made:
            made.append(factors)
    return made


def add_limits(search: Search, plain: Hypothesis) -> Hypothesis:
    """Return the fit with torque limits and a delay of the arm where they are worth their price."""
    half = np.arange(0, len(search.sub.evidence), 2)
    task = search.sub.select(half)
    search.say("  screening torque limits and delays beside the plain fit")
    above = search.above_floor(plain)
    found = screen(task, plain.fit.select(task, half), search.sizes, above, search.changes, LIMITS)
    reach = plain.fit.select(task, half).loss
    for name in LIMITS:
        alike = [c.effect for c in found if c.effect.name() == name and c.loss + 0.5 * PRICE < reach]
        whole = [effect for effect in alike if effect.joint is None]
        chosen = whole or alike
        if chosen:
            more = search.fitted(plain.description.adding(*chosen), plain.fit.factors, plain.fit, 6, 1)
            if more is not None and more.score < plain.score:
                plain = more
    return plain


def as_effects(search: Search, plain: Hypothesis) -> Description:
    """Return the same description with effects in the place of freed parameters, where they can be named.

    Friction, inertia and damping above the model's are added to it; a gain is multiplied; a limit below the model's is
    set. What the model has too much of otherwise, or a limit that is too low, has no name and stays freed. What ended
    within what a real arm is off by is bound again, and an offset that the readings do not show is left out.
    """
    spec, factors = search.train.nominal.spec, plain.fit.factors
    freed = {name for name in plain.description.freed if abs(math.log(factors[name])) > MAX_LOG_CHANGE}
    floor = dict(zip(search.train.nominal.joints, search.train.floor, strict=True))
    effects = [effect for effect in plain.effects if not is_unseen(effect, floor)]
    present = {(effect.name(), effect.joint) for effect in effects}
    kinds = {kind: (effect, way) for effect, (kind, way) in NAMED.items()}
    for name in sorted(freed):
        joint, kind = name.rsplit(".", 1)
        effect, way = kinds.get(kind, ("", FACTOR))
        factor, own = factors[name], own_value(spec, joint, kind)
        value = {FACTOR: factor, ADDED: (factor - 1) * own, LOWERED: factor * own if factor < 1 else 0.0}[way]
        if effect and value > 0:
            freed.discard(name)
            if (effect, joint) not in present:
                effects.append(make_clipped_effect(effect, joint, value))
    return replace(plain.description, effects=tuple(effects), freed=frozenset(freed))


def columns_as_effects(plain: Fit, parameters: FreeParameters) -> dict[int, np.ndarray]:
    """Return the plain fit's columns for the numbers of the description that `as_effects` makes of it, by index.

    An effect added to the model's own value v multiplies it by f, so that d log f / d log(added) = (f − 1) / f.
    """
    columns: dict[Label, np.ndarray] = dict(zip(plain.parameters.labels, plain.jacobian, strict=True))
    known = reuse_jacobian(plain, parameters)
    for index, (effect, joint, *_) in enumerate(parameters.labels[: len(parameters.of_effects)]):
        kind, way = NAMED.get(effect or "", ("", FACTOR))
        if (column := columns.get((f"{joint}.{kind}",))) is not None:
            factor = plain.factors[f"{joint}.{kind}"]
            known[index] = column * ((factor - 1) / factor if way == ADDED else 1.0)
    return known


def is_unseen(effect: Effect, floor: Mapping[str, float]) -> bool:
    """Whether an effect is an offset of less than a noise floor [rad]."""
    return isinstance(effect, JointOffset) and abs(effect.offset) < floor[effect.joint or ""]


def make_clipped_effect(name: str, joint: str, value: float) -> Effect:
    """Return an effect with its first parameter within its bounds."""
    first = find_effect(name).parameters[0]
    return make_effect(name, joint, {first.name: float(np.clip(value, first.low, first.high))})
