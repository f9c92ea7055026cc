"""Plain fit: every smooth parameter of every joint above the floor, without names."""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from itertools import product

import mujoco
import numpy as np

from nas_data.count_of import count_of
from nas_data.effects.base import Effect, Scales, find_effect, make_effect
from nas_data.effects.edits.servo import read_servo_stiffness
from nas_data.effects.joint_offset import JointOffset
from nas_data.gap.nominal_parameters import MAX_LOG_CHANGE, NominalParameter, read_own_value
from nas_data.gap.search.constants import ERROR_SHARE, MAX_ALTERNATIVES, PRICE, SHORT_WINDOW
from nas_data.gap.search.fit import Fit, fit, group_moved_joints, is_effect_or_freed
from nas_data.gap.search.hypothesis import Description, Hypothesis, effect_key, reuse_jacobian
from nas_data.gap.search.objective import FitTask
from nas_data.gap.search.parameters import FREED_ONLY, FreeParameters, Label
from nas_data.gap.search.screen import screen
from nas_data.gap.search.search import Search
from nas_data.gap.search.share_gain import share_gain
from nas_data.gap.side_by_side import map_in_parallel
from nas_data.gap.windows import cut_windows

SHORT_STEPS = 8_000  # most physics steps of one rollout of short windows
FACTORS = (1.0, 0.3, 0.1, 0.03)  # initial factors of all gains; filters take the first and the last
INITIAL_SHARE = 0.1  # of a joint's scale: initial value of an effect that the model lacks …
SIZES = (0.01, 0.1, 1.0)  # … and multiples of it that are tried
START_TOLERANCE = 0.3  # [nats per observation] by which a start may be worse than the best and still be fitted
FACTOR, ADDED, LOWERED = "factor", "added", "lowered"
EFFECT_OF_PARAMETER = {  # effect: the equivalent freed parameter, and how its value is converted
    "servo_stiffness": ("gain", FACTOR),
    "servo_damping": ("servo_damping", FACTOR),
    "torque_limit": ("limit", LOWERED),
    "viscous_friction": ("damping", ADDED),
    "rotor_inertia": ("armature", ADDED),
    "coulomb_friction": ("frictionloss", ADDED),
}
LIMIT_EFFECTS = ("torque_limit", "command_delay")  # effects that a plain fit includes if they are worth their price
SMOOTH_EFFECTS = {"joint_offset", *EFFECT_OF_PARAMETER}.difference(LIMIT_EFFECTS)  # equivalents of what it always has


def fit_plain(search: Search) -> Hypothesis:
    """Fit every smooth parameter of joints above the floor, then torque limits and a delay if they are worth it."""
    return add_limits(search, refine_smooth(search, fit_smooth(search)))


def fit_smooth(search: Search) -> Hypothesis:
    """Fit gain, damping, rotor inertia, dry and viscous friction, offset and filters of joints above the floor.

    Joints at the floor are not freed, because more freedom would fit noise. The fit begins on short windows from
    several gains, and ends on the episodes of the search.
    """
    joints = search.find_joints_above_floor(search.null)
    if not joints:
        return search.null
    description = describe_plain_fit(search, joints)
    parameters = description.parameters(search.train.nominal.base)
    count = f"{count_of(parameters.size, 'number')} of {count_of(len(joints), 'joint')}"
    search.say(f"plain fit: {count}, on windows of {SHORT_WINDOW:g} s")
    found = fit_short_windows(search, description)
    search.say(f"plain fit: {count}, on the episodes of the search")
    if not found:  # the model is near, so that parameters move the same joints as there
        base = Description().parameters(search.train.nominal.base)
        search.task = replace(search.task, moved_by_joint=group_moved_joints(search.task, base))
    start = found.theta if found else choose_start(search, parameters)
    known = {} if found else reuse_jacobian(search.null.fit, parameters, len(description.effects))
    known = {column: rows for column, rows in known.items() if not is_effect_or_freed(parameters, column)}
    whole = fit(search.task, parameters, start, known, steps=8, jacobian_refreshes=2)
    if whole is None or not whole.loss < search.null.fit.loss:
        return search.null
    plain = search.evaluate(description, whole)
    search.report("plain fit", plain)
    return plain


def refine_smooth(search: Search, plain: Hypothesis) -> Hypothesis:
    """Fit on while this improves a smooth fit above the floor, also with one factor on all gains.

    The search continues with the objective of the fit.
    """
    if plain is search.null or search.floor_ratios(plain).max() <= search.at_floor:
        return plain
    plain = search.relinearise(plain)
    search.report("plain fit", plain)
    alike = share_gain(search, plain)
    if alike is not plain:
        alike = search.relinearise(alike)
        search.report("plain fit with one gain", alike)
    return alike


def choose_start(search: Search, parameters: FreeParameters) -> np.ndarray:
    """Return the initial θ near the model: for each joint the effects of the size with the smallest error.

    Friction of a tenth of a strong servo's torque, for example, is far from the model.
    """
    starts = list_near_starts(parameters, search.null.fit.factors)
    predicted = [search.task.predict(parameters, start) for start in starts]
    starts.append(mix_starts(search.task, parameters, starts, predicted))
    predicted.append(search.task.predict(parameters, starts[-1]))
    return starts[int(np.argmin([search.task.misfit(rows) for rows in predicted]))]


def list_near_starts(parameters: FreeParameters, factors: dict[str, float]) -> list[np.ndarray]:
    """Return θ at some factors of the model's parameters, with effects of each initial size, smallest first."""
    starts = [parameters.initial_theta(factors) for _ in SIZES]
    for start, size in zip(starts, SIZES, strict=True):
        for column, free in enumerate(parameters.effect_parameters):
            if not free.signed:  # θ is the logarithm of the size
                start[column] = math.log(size)
    return starts


def describe_plain_fit(search: Search, joints: Collection[str]) -> Description:
    """Return the plain fit's description: freed base parameters of some joints, and effects that the model lacks."""
    nominal, spec = search.train.nominal, search.train.nominal.spec
    freed = frozenset(p.name for p in nominal.base if p.kind != "mass" and p.joint in joints)
    effects: list[Effect] = []
    for joint in filter(joints.__contains__, nominal.joints):
        sizes = search.find_scales(joint)
        lacking = {
            "coulomb_friction": ("torque", INITIAL_SHARE * sizes.torque, float(spec.joint(joint).frictionloss)),
            "viscous_friction": (
                "coefficient",
                INITIAL_SHARE * compute_natural_damping(sizes),
                float(spec.joint(joint).damping[0]),
            ),
            "rotor_inertia": ("inertia", INITIAL_SHARE * sizes.inertia, float(spec.joint(joint).armature)),
        }
        effects += [make_effect(name, joint, {key: size}) for name, (key, size, own) in lacking.items() if own == 0]
        if read_servo_stiffness(spec, joint) > 0:
            effects.append(make_effect("joint_offset", joint, {"offset": 1e-6}))
    return Description(tuple(effects), freed)


def compute_natural_damping(sizes: Scales) -> float:
    """Return a joint's large torque over its large speed [N·m·s/rad], or its damping if that is larger."""
    return max(sizes.damping, sizes.torque / sizes.speed)


def fit_short_windows(search: Search, description: Description) -> Fit | None:
    """Fit short windows from the best of several initial values; None if none clearly beats the model."""
    nominal = search.train.nominal
    rows = SHORT_STEPS // nominal.simulator().substeps
    evidence = cut_windows(search.train.evidence, rows, SHORT_WINDOW)
    parameters = description.parameters(nominal.base)
    task = FitTask(nominal, evidence, search.train.floor, fine=False)
    starts = list_near_starts(parameters, {})  # the first is nearly the given model
    starts += [parameters.initial_theta(factors) for factors in list_starting_factors(description.freed)]
    predicted = [task.predict(parameters, start) for start in starts]
    starts.append(mix_starts(task, parameters, starts, predicted))
    predicted.append(task.predict(parameters, starts[-1]))
    observation = float(task.observations.sum()) * len(task.floor)
    misfits = np.array([task.misfit(rows) for rows in predicted]) / observation
    order = np.argsort(misfits)
    if not misfits[order[0]] < misfits[0] - ERROR_SHARE:
        return None
    best = [
        starts[number] for number in order[:MAX_ALTERNATIVES] if misfits[number] < misfits[order[0]] + START_TOLERANCE
    ]
    first = task.relinearise(parameters, best[0])
    fitted = map_in_parallel(lambda theta: fit(first, parameters, theta, steps=4, jacobian_refreshes=1), best)
    found = min(filter(None, fitted), key=lambda one: one.loss)
    task = task.relinearise(parameters, found.theta)
    return fit(task, parameters, found.theta, steps=6, jacobian_refreshes=2) or found


def mix_starts(
    task: FitTask, parameters: FreeParameters, starts: Sequence[np.ndarray], predicted: Sequence[np.ndarray | None]
) -> np.ndarray:
    """Return θ that takes the best of several initial values for each joint."""
    far = np.full(len(task.floor), np.inf)
    errors = [far if rows is None else task.misfits(rows).sum(0) for rows in predicted]
    best = dict(zip(task.nominal.joints, np.argmin(errors, axis=0), strict=True))
    joints = [parameters.find_local_joint(column) for column in range(parameters.size)]
    return np.array([starts[best.get(joint or "", 0)][column] for column, joint in enumerate(joints)])


def list_starting_factors(freed: frozenset[str]) -> Sequence[dict[str, float]]:
    """Return initial factors of gains, servo damping (the gain of a velocity servo) and filters."""
    gains = FACTORS if any(name.endswith((".gain", ".servo_damping")) for name in freed) else (1.0,)
    dampings = (
        (0.0, 0.5, 1.0) if any(name.endswith(".servo_damping") for name in freed) else (0.0,)
    )  # powers of the gain
    filters = (FACTORS[0], FACTORS[-1]) if any(name.endswith(".filter") for name in freed) else (1.0,)
    made = []
    for gain, power, filtered in product(gains, dampings, filters):
        kinds = {"gain": gain, "servo_damping": gain**power, "filter": filtered}
        factors = {name: kinds[kind] for name in freed if (kind := name.rsplit(".", 1)[1]) in kinds}
        if factors not in made:
            made.append(factors)
    return made


def add_limits(search: Search, plain: Hypothesis) -> Hypothesis:
    """Add torque limits and a delay of the arm to a smooth fit above the floor if they are worth their price.

    The search is at the objective of the fit.
    """
    if plain is search.null or search.floor_ratios(plain).max() <= search.at_floor:
        return plain
    half = np.arange(0, len(search.task.evidence), 2)
    task = search.task.select(half)
    search.say("  screening torque limits and delays beside the plain fit")
    above = search.find_joints_above_floor(plain)
    found = screen(task, plain.fit.select(task, half), search.scales, above, search.known_changes, LIMIT_EFFECTS)
    kept_loss = plain.fit.select(task, half).loss
    for name in LIMIT_EFFECTS:
        alike = [c.effect for c in found if c.effect.name() == name and c.loss + 0.5 * PRICE < kept_loss]
        whole = [effect for effect in alike if effect.joint is None]
        chosen = whole or alike
        if chosen:
            more = search.fit_description(plain.description.add_effects(*chosen), plain.fit.factors, plain.fit, 6, 1)
            if more is not None and more.score < plain.score:
                plain = more
                search.report("plain fit with limits", plain)
    return plain


def convert_to_effects(search: Search, plain: Hypothesis) -> Description:
    """Return the plain fit's description with effects in place of freed parameters, where an effect is equivalent.

    Friction, inertia and damping above the model's become added amounts, gains become factors, and lower limits become
    limits. Parameters below the model's that have no equivalent stay freed. Parameters within ±25 % are bound again,
    and offsets below the noise floor are left out.
    """
    spec, factors = search.train.nominal.spec, plain.fit.factors
    freed = {name for name in plain.description.freed if abs(math.log(factors[name])) > MAX_LOG_CHANGE}
    floor = dict(zip(search.train.nominal.joints, search.train.floor, strict=True))
    effects = [effect for effect in plain.effects if not is_below_floor(effect, floor)]
    present = {effect_key(effect) for effect in effects}
    for name in sorted(freed):
        if (effect := convert_parameter(spec, name, factors[name])) is not None:
            freed.discard(name)
            if effect_key(effect) not in present:
                effects.append(effect)
    return replace(plain.description, effects=tuple(effects), freed=frozenset(freed))


def convert_parameter(spec: mujoco.MjSpec, name: str, factor: float) -> Effect | None:
    """Return the effect that is equivalent to a factor on a parameter of a model; None if there is none."""
    joint, kind = name.rsplit(".", 1)
    effect, way = next(((key, way) for key, (own, way) in EFFECT_OF_PARAMETER.items() if own == kind), ("", FACTOR))
    own = read_own_value(spec, joint, kind)
    value = {FACTOR: factor, ADDED: (factor - 1) * own, LOWERED: factor * own if factor < 1 else 0.0}[way]
    return make_clipped_effect(effect, joint, value) if effect and value > 0 else None


def convert_to_factor(search: Search, effect: Effect) -> tuple[NominalParameter, float] | None:
    """Return the bound base parameter that can stand for a small effect, and its factor; None if there is none.

    Its factor has to be within the parameter's bounds. A torque limit has none: the model's own is fixed unless freed.
    """
    kind, way = EFFECT_OF_PARAMETER.get(effect.name(), ("", FACTOR))
    parameter = next((p for p in search.train.nominal.base if (p.joint, p.kind) == (effect.joint, kind)), None)
    if parameter is None or kind in FREED_ONLY:
        return None
    value = float(getattr(effect, effect.free_parameters[0].name))
    own = read_own_value(search.train.nominal.spec, parameter.joint, kind)
    factor = 1 + value / own if way == ADDED and own > 0 else value if way == FACTOR else math.inf
    low, high = parameter.bounds
    return (parameter, factor) if 0 < factor < math.inf and low <= math.log(factor) <= high else None


def convert_columns(plain: Fit, parameters: FreeParameters) -> dict[int, np.ndarray]:
    """Return the plain fit's columns for the description of `convert_to_effects`, by index.

    An amount added to the model's value v gives the factor f, with d log f / d log(amount) = (f − 1) / f.
    """
    columns: dict[Label, np.ndarray] = dict(zip(plain.parameters.labels, plain.jacobian, strict=True))
    known = reuse_jacobian(plain, parameters)
    for index, (effect, joint, *_) in enumerate(parameters.labels[: len(parameters.effect_parameters)]):
        kind, way = EFFECT_OF_PARAMETER.get(effect or "", ("", FACTOR))
        if (column := columns.get((f"{joint}.{kind}",))) is not None:
            factor = plain.factors[f"{joint}.{kind}"]
            known[index] = column * ((factor - 1) / factor if way == ADDED else 1.0)
    return known


def is_below_floor(effect: Effect, floor: Mapping[str, float]) -> bool:
    """Whether an effect is an offset below its joint's noise floor [rad]."""
    return isinstance(effect, JointOffset) and abs(effect.offset) < floor[effect.joint or ""]


def make_clipped_effect(name: str, joint: str, value: float) -> Effect:
    """Return an effect with its first parameter clipped to its bounds."""
    first = find_effect(name).parameters[0]
    return make_effect(name, joint, {first.name: float(np.clip(value, first.low, first.high))})
