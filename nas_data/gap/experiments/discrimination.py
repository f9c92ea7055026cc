"""Difference of two hypotheses in an experiment after one is fitted to the other."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from nas_data.effects.base import Effect
from nas_data.gap.episode_batch import EpisodeBatch, pad_rows
from nas_data.gap.nominal import Nominal
from nas_data.gap.nominal_parameters import NominalParameter, scale_base_parameters
from nas_data.gap.search.fit import Expansion, build_normal_equations, fit, measure_jacobian
from nas_data.gap.search.objective import FitTask
from nas_data.gap.search.parameters import FreeParameters, select_free_base
from nas_data.gap.side_by_side import map_in_parallel

STEPS = 4  # Gauss-Newton steps of the second one; after two it has not converged


@dataclass(frozen=True)
class Explanation:
    """One explanation of the recorded data.

    Attributes:
        effects: Fitted effects.
        factors: Fitted factors of base parameters, by name.
    """

    effects: tuple[Effect, ...]
    factors: Mapping[str, float]


def find_differing_joints(explanations: tuple[Explanation, Explanation], joints: Sequence[str]) -> tuple[str, ...]:
    """Return the joints with an effect that only one explanation has; all joints for an effect of the whole arm."""
    one, two = ({(effect.name(), effect.joint) for effect in explanation.effects} for explanation in explanations)
    places = {joint for _, joint in one ^ two}
    return tuple(joint for joint in joints if not places or None in places or joint in places)


def make_batch(nominal: Nominal, commands: Sequence[np.ndarray], pose: np.ndarray) -> EpisodeBatch:
    """Return commands (T, n) as episodes from an initial pose [rad; m] (n,), without measurements."""
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
    nominal: Nominal,
    explanations: tuple[Explanation, Explanation],
    recorded: EpisodeBatch,
    evidence: EpisodeBatch,
    floor: np.ndarray,
    concerned: Sequence[str],
) -> np.ndarray:
    """Return the difference of two explanations in each experiment, after the second is fitted to the first.

    T-optimality (Atkinson and Fedorov, 1975): only what the second cannot imitate distinguishes them. It has to explain
    the recorded episodes, too: their curvature about its parameters holds these.

    Args:
        nominal: Given model.
        explanations: The second is fitted to the predictions of the first.
        recorded: Episodes to which both are fitted already.
        evidence: E experiments of n joints.
        floor: Noise floor of each joint [rad; m], shape (n,).
        concerned: Joints in which the explanations differ.

    Returns:
        RMS difference over the noise floor, shape (E, n); 0 for other joints.

    Raises:
        ModelFileError: an explanation diverges.
    """
    leader, follower = explanations
    first = nominal.predict(evidence, leader.effects, leader.factors)
    task = FitTask(make_follower(nominal, follower, concerned), replace(evidence, measured=first), floor)
    parameters = FreeParameters(follower.effects, select_free_parameters(nominal, follower, concerned))
    start = parameters.initial_theta(dict(follower.factors))
    others = expand_misfit(replace(task, evidence=recorded), parameters, start)
    # measured for all experiments in one batch; each experiment is then fitted alone
    second = task.nominal.predict(evidence, follower.effects, parameters.factors_at(start))
    jacobian = measure_jacobian(task, parameters, start, second, range(parameters.size))

    def follow(episode: int) -> np.ndarray:
        alone, known = task.select([episode]), dict(enumerate(jacobian[:, [episode]]))
        found = fit(alone, parameters, start, known, STEPS, 0, others)
        return alone.evidence.mean_squares(found.predicted) if found else np.zeros((1, len(alone.floor)))

    squares = np.concatenate(map_in_parallel(follow, range(len(evidence))))
    counted = np.isin(nominal.joints, list(concerned))
    return np.asarray(np.where(counted, np.sqrt(squares) / floor, 0.0))


def expand_misfit(task: FitTask, parameters: FreeParameters, theta: np.ndarray) -> Expansion:
    """Return the misfit of a task's episodes to second order about θ; zero if the model diverges there."""
    predicted = task.predict(parameters, theta)
    if predicted is None:
        return Expansion.zero(parameters.size)
    jacobian = measure_jacobian(task, parameters, theta, predicted, range(parameters.size))
    return Expansion(theta, *build_normal_equations(task, predicted, jacobian))


def select_free_parameters(
    nominal: Nominal, explanation: Explanation, concerned: Sequence[str]
) -> tuple[NominalParameter, ...]:
    """Return the base parameters that the second one may adapt: masses, and those of the concerned joints."""
    return tuple(
        p for p in select_free_base(nominal.base, explanation.effects) if p.kind == "mass" or p.joint in concerned
    )


def make_follower(nominal: Nominal, explanation: Explanation, concerned: Sequence[str]) -> Nominal:
    """Return the model with the fixed base factors of an explanation."""
    free = {parameter.name for parameter in select_free_parameters(nominal, explanation, concerned)}
    kept = {name: factor for name, factor in explanation.factors.items() if name not in free}
    return nominal.with_edit(lambda spec: scale_base_parameters(spec, nominal.base, kept))
