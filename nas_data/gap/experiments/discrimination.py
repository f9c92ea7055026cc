"""How far two hypotheses stay apart in an experiment when one of them may follow the other as far as it can."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from nas_data.effects.base import Effect
from nas_data.gap.episode_batch import EpisodeBatch, pad_rows
from nas_data.gap.nominal import Nominal
from nas_data.gap.nominal_parameters import NominalParameter, scale_base_parameters
from nas_data.gap.search.fit import Fit, fit, measure_jacobian
from nas_data.gap.search.objective import FitTask
from nas_data.gap.search.parameters import FreeParameters, select_free_base

STEPS = 4  # Gauss-Newton steps by which the second rival follows; after two, it is still on its way


@dataclass(frozen=True)
class Rival:
    """One explanation of what was recorded so far.

    Attributes:
        effects: Fitted effects.
        factors: Fitted base factors, by name.
    """

    effects: tuple[Effect, ...]
    factors: Mapping[str, float]


def find_differing_joints(rivals: tuple[Rival, Rival], joints: Sequence[str]) -> tuple[str, ...]:
    """Return the joints with an effect that only one rival has; all where that belongs to the whole arm."""
    one, two = ({(effect.name(), effect.joint) for effect in rival.effects} for rival in rivals)
    places = {joint for _, joint in one ^ two}
    return tuple(joint for joint in joints if not places or None in places or joint in places)


def make_batch(nominal: Nominal, commands: Sequence[np.ndarray], pose: np.ndarray) -> EpisodeBatch:
    """Return experiments (T, n) as episodes from a first pose [rad] (n,) in which nothing was measured yet."""
    longest = max(len(rows) for rows in commands)
    stacked = np.stack([pad_rows(rows, longest) for rows in commands])
    return EpisodeBatch(
        joints=nominal.joints,
        period=nominal.period,
        initial_positions=np.tile(pose, (len(commands), 1)),
        commands=stacked,
        measured=np.zeros_like(stacked),
        mask=np.stack([np.arange(longest) < len(rows) for rows in commands]),
        numbers=np.arange(len(commands)),
    )


def compute_separations(
    nominal: Nominal, rivals: tuple[Rival, Rival], evidence: EpisodeBatch, floor: np.ndarray, concerned: Sequence[str]
) -> np.ndarray:
    """Return how far the rivals differ in each experiment after the second was fitted to what the first predicts.

    T-optimality (Atkinson and Fedorov, 1975): only what the second cannot imitate tells them apart.

    Args:
        nominal: Model as handed over.
        rivals: What the first predicts, the second follows.
        evidence: E experiments of n joints.
        floor: Noise floor of each joint [rad], shape (n,).
        concerned: Joints in which the rivals differ.

    Returns:
        RMS difference over the noise floor, shape (E, n); zero for joints that are not concerned.

    Raises:
        ModelFileError: a rival diverges.
    """
    leader, follower = rivals
    first = nominal.predict(evidence, leader.effects, leader.factors)
    task = FitTask(make_follower(nominal, follower, concerned), replace(evidence, measured=first), floor)
    parameters = FreeParameters(follower.effects, select_free_parameters(nominal, follower, concerned))
    start = parameters.initial_theta(dict(follower.factors))
    second = task.nominal.predict(evidence, follower.effects, parameters.factors_at(start))
    # found for all experiments in one batch: from here on, each has numbers of its own
    common = [column for column in range(parameters.size) if not is_concerned(parameters, column, concerned)]
    known = dict(zip(common, measure_jacobian(task, parameters, start, second, common), strict=True))
    followed = [
        fit(task.select([episode]), parameters, start, {c: rows[[episode]] for c, rows in known.items()}, STEPS, 0)
        for episode in range(len(evidence))
    ]
    squares = np.concatenate([mean_squares(task.select([episode]), found) for episode, found in enumerate(followed)])
    counted = np.isin(nominal.joints, list(concerned))
    return np.asarray(np.where(counted, np.sqrt(squares) / floor, 0.0))


def is_concerned(parameters: FreeParameters, column: int, concerned: Sequence[str]) -> bool:
    """Whether a number is that of an effect of a concerned joint, or of the arm."""
    if column >= len(parameters.effect_parameters):
        return False
    return any(effect.joint is None or effect.joint in concerned for effect in parameters.effects_of(column))


def mean_squares(task: FitTask, found: Fit | None) -> np.ndarray:
    """Return the mean squares that a fit leaves [rad²], shape (1, n); none is shown where there is no fit."""
    return task.evidence.mean_squares(found.predicted) if found else np.zeros((1, len(task.floor)))


def select_free_parameters(nominal: Nominal, rival: Rival, concerned: Sequence[str]) -> tuple[NominalParameter, ...]:
    """Return the base parameters by which a rival follows: masses, and what the concerned joints have."""
    return tuple(p for p in select_free_base(nominal.base, rival.effects) if p.kind == "mass" or p.joint in concerned)


def make_follower(nominal: Nominal, rival: Rival, concerned: Sequence[str]) -> Nominal:
    """Return the model with those of a rival's base factors that stay as they are."""
    free = {parameter.name for parameter in select_free_parameters(nominal, rival, concerned)}
    kept = {name: factor for name, factor in rival.factors.items() if name not in free}
    return nominal.with_edit(lambda spec: scale_base_parameters(spec, nominal.base, kept))
