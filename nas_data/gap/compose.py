"""Composition of the gap report, and the series for its figures."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from nas_data.effects.base import Effect
from nas_data.errors import ModelFileError
from nas_data.gap.floor import compute_floor_ratios
from nas_data.gap.name import Finding, Naming
from nas_data.gap.nominal import Nominal
from nas_data.gap.nominal_parameters import FIRM
from nas_data.gap.problem import Problem
from nas_data.gap.report import GapReport
from nas_data.gap.report_effects import (
    Alternative,
    EffectName,
    Evidence,
    FittedEffect,
    FittedParameter,
    NamedEffect,
    Placebo,
)
from nas_data.gap.report_parts import (
    LESS_BASELINE,
    ArmGap,
    EpisodeNumbers,
    GapErrors,
    GapFindings,
    JointDescription,
    Retuned,
    Shares,
    TriedExperiment,
    Unexplained,
)
from nas_data.gap.residual_correlates import find_residual_correlate
from nas_data.gap.score_model import HeldOutResult
from nas_data.gap.search.constants import EXPLAINED
from nas_data.gap.search.final import list_parameters, list_retuned
from nas_data.gap.search.objective import FitTask
from nas_data.gap.showing.series import SERIES
from nas_data.gap.verdict import decide_verdict, find_above
from nas_data.joint_units import find_joint_unit, group_by_kind
from nas_data.typed_json import from_json

METRIC = "open-loop position RMSE on held-out episodes"
JUST_EXPLAINED = 0.8  # completeness of a joint whose error just counts as explained
SURELY_EXPLAINED = 1.25  # noise floors that count as explained while another joint of the arm is not


@dataclass(frozen=True)
class Proposal:
    """Proposed experiment.

    Attributes:
        text: One sentence; None if all names are certain.
        compared: All experiments that were compared.
    """

    text: str | None = None
    compared: tuple[TriedExperiment, ...] = ()


def compose(
    problem: Problem, found: GapFindings, naming: Naming, outcome: HeldOutResult, experiment: Proposal, seconds: float
) -> GapReport:
    """Return the report without its other files.

    Args:
        problem: Recording and model.
        found: Location of the gap.
        naming: Named effects.
        outcome: Predictions of the models.
        experiment: Proposed experiment.
        seconds: Duration of the search [s].
    """
    held = problem.held
    before, after = (compute_floor_ratios(part.squares, held.floors) for part in (outcome.before, outcome.after))
    dataset, model = problem.names
    retuned = tuple(from_json(Retuned, entry) for entry in list_retuned(naming.final))
    named, added = len(naming.findings), len(naming.final.effects)
    large = () if named or added else find_large(retuned)
    verdict = decide_verdict(before, after, named, added + len(large), len(retuned))
    conditioning = float(f"{naming.final.conditioning:.3g}")
    gap = measure_gap(held, outcome, conditioning)
    if problem.subtracts_baseline:
        gap = replace(gap, metric=gap.metric + LESS_BASELINE)
    return GapReport(
        dataset=dataset,
        model=model,
        verdict=verdict,
        effects=tuple(
            describe_finding(finding, held.nominal, outcome.contains(finding.effect)) for finding in naming.findings
        ),
        retuned=retuned,
        joints=describe_joints(held, naming, after),
        unexplained=find_unexplained(held, outcome.after.positions, after, large if verdict == "unexplained" else ()),
        gap=gap,
        conditioning=conditioning,
        shares=measure_shares(held, outcome),
        phi=outcome.learned,
        placebo=describe_placebo(held, naming),
        next_experiment=experiment.text,
        experiments=experiment.compared,
        find=found,
        episodes=EpisodeNumbers(
            train=tuple(np.unique(problem.number_episodes(problem.train.evidence)).tolist()),
            heldout=tuple(np.unique(problem.number_episodes(held.evidence)).tolist()),
            begin_in_motion=held.evidence.begins_in_motion,
        ),
        seed=0,
        seconds=round(seconds, 2),
        registers=problem.as_given.registers.values or None,
    )


def describe_finding(finding: Finding, nominal: Nominal, in_file: bool) -> NamedEffect:
    """Return a finding as the report lists it.

    Args:
        finding: Named effect.
        nominal: Model, whose joints decide the units.
        in_file: Whether the model file contains the effect.
    """
    effect, slides = finding.effect, nominal.slides
    joint = effect.local_joint
    unit = find_joint_unit(joint, slides) if joint else group_by_kind(nominal.joints, slides)[0][0]
    found = list_parameters(effect, finding.interval, finding.episode_range, slides)
    return NamedEffect(
        name=effect.name(),
        joint=effect.joint,
        parameters={name: from_json(FittedParameter, entry) for name, entry in found.items()},
        confidence=finding.confidence,
        evidence=Evidence(
            heldout_error_before=finding.before,
            heldout_error_after=finding.after,
            unit=unit.si,
            closest_rival=round(finding.support.closest_rival, 3),
            chosen=round(finding.support.chosen, 3),
            position_dependence=round_optional(finding.support.position_dependence),
        ),
        alternatives=tuple(describe_alternative(rival.effect, rival.error) for rival in finding.rivals if rival.effect),
        equals=tuple(
            EffectName(name=rival.effect.name(), joint=rival.effect.joint)
            for rival in finding.rivals
            if rival.effect and rival.is_equal
        ),
        in_model_xml=in_file,
    )


def round_optional(value: float | None) -> float | None:
    """Return a number with three decimals, None for None."""
    return None if value is None else round(value, 3)


def describe_alternative(effect: Effect, error: float) -> Alternative:
    """Return an alternative as the report lists it."""
    numbers = {p.name: float(getattr(effect, p.name)) for p in effect.free_parameters}
    return Alternative(name=effect.name(), joint=effect.joint, parameters=numbers, heldout_error_after=error)


def describe_joints(held: FitTask, naming: Naming, after: np.ndarray) -> Mapping[str, JointDescription]:
    """Return completeness, held-out error over the floor and stability of each joint.

    A cause that is missing in one joint may act weakly on the others, too, so that less is enough to doubt them.

    Args:
        held: Model and held-out episodes.
        naming: Named effects.
        after: Held-out error over the floor with the named effects, shape (n,).
    """
    limit = SURELY_EXPLAINED if after.max() > EXPLAINED else EXPLAINED
    return {
        joint: JointDescription(
            complete=compute_completeness(float(ratio), limit, list_confidences(naming, joint)),
            ratio_to_noise=round(float(ratio), 2),
            stable=find_stability(naming, joint),
        )
        for joint, ratio in zip(held.evidence.joints, after, strict=True)
    }


def find_stability(naming: Naming, joint: str) -> bool | None:
    """Return whether two halves agree on a joint's parameters; None if there is only one recording, or window."""
    is_named = any(finding.effect.local_joint == joint for finding in naming.findings)
    return naming.stable.get(joint, None if is_named else True)


def compute_completeness(ratio: float, limit: float, confidences: Sequence[float]) -> float:
    """Return how complete a joint's description is, 0 to 1.

    It is below `JUST_EXPLAINED` for joints that are not explained, and at most the lowest confidence of the names.

    Args:
        ratio: Held-out error over the floor with the named effects.
        limit: Ratio up to which the joint counts as explained.
        confidences: Those of the joint's names and of the whole arm's.
    """
    return round(min(1.0, JUST_EXPLAINED * (limit / max(ratio, 1e-9)) ** 2, *confidences), 3)


def list_confidences(naming: Naming, joint: str) -> list[float]:
    """Return the confidence of each name of a joint and of the whole arm."""
    return [finding.confidence for finding in naming.findings if finding.effect.local_joint in (joint, None)]


def find_large(retuned: Sequence[Retuned]) -> tuple[Retuned, ...]:
    """Return the parameters that changed by more than 25 %; firm friction is a setting of the solver."""
    return tuple(entry for entry in retuned if entry.is_large and not entry.parameter.endswith(FIRM))


def find_unexplained(
    held: FitTask, predicted: np.ndarray, after: np.ndarray, large: Sequence[Retuned] = ()
) -> tuple[Unexplained, ...]:
    """Return the joints with an unexplained error, and what it goes with.

    Args:
        held: Model and held-out episodes.
        predicted: Predicted positions [rad; m], shape (E, T, n).
        after: Their error over the floor, shape (n,).
        large: Parameters whose change by more than 25 % stands for a cause without a name. They are listed for joints
            at the floor.
    """
    errors = held.evidence.errors(predicted)
    joints = held.evidence.joints
    at_floor = {entry.joint: entry.parameter for entry in large if after[joints.index(entry.joint)] <= EXPLAINED}
    return tuple(
        Unexplained(
            joint=joints[joint],
            ratio_to_noise=round(float(after[joint]), 2),
            goes_with=find_residual_correlate(held.evidence, errors, joint, held.nominal.slides),
        )
        for joint in find_above(after, EXPLAINED)
    ) + tuple(
        Unexplained(joint=joint, ratio_to_noise=round(float(after[joints.index(joint)]), 2), goes_with=parameter)
        for joint, parameter in at_floor.items()
    )


def measure_gap(held: FitTask, outcome: HeldOutResult, conditioning: float | None = None) -> ArmGap:
    """Return the held-out errors of all models, per joint and pooled over the joints of each kind.

    Errors over hinges are at the top if there are any. For an arm with slides as well, their errors are under `slides`,
    because radians and metres have no common mean.

    Raises:
        ModelFileError: the given model or that with the effects diverges.
    """
    if not (outcome.before.is_finite and outcome.after.is_finite):
        raise ModelFileError(
            "The model diverges in MuJoCo on a held-out episode; shorten its timestep, or correct its effects and "
            "retuned parameters."
        )
    models = {
        "before": outcome.before, "plain": outcome.plain, "after": outcome.after, "after_model_xml": outcome.written,
    }  # fmt: skip
    squares = {
        name: held.evidence.mean_squares(predicted.positions).mean(0)
        for name, predicted in models.items()
        if predicted.is_finite
    }
    squares = {"noise_floor": held.mean_floor**2, **squares}

    def pooled(places: np.ndarray) -> dict[str, float]:
        return {name: float(np.sqrt(row[places].mean())) for name, row in squares.items()}

    def of_joint(place: int, unit: str) -> GapErrors:
        return replace(GapErrors(unit=unit, **pooled(np.array([place]))), after_model_xml=None)

    joints, slides = held.evidence.joints, held.nominal.slides
    (unit, places), *others = group_by_kind(joints, slides)
    beside = [GapErrors(unit=other.si, **pooled(rest)) for other, rest in others]
    return ArmGap(
        unit=unit.si,
        **pooled(places),
        metric=METRIC + (f", over the {unit.kind} ({others[0][0].kind} beside)" if others else ""),
        delivered=outcome.delivered,
        slides=beside[0] if beside else None,
        per_joint={joint: of_joint(place, find_joint_unit(joint, slides).si) for place, joint in enumerate(joints)},
        conditioning=conditioning,
    )


def measure_shares(held: FitTask, outcome: HeldOutResult) -> Shares:
    """Return the shares of the squared gap above the floor that names and φ explain, and the share that is left.

    Squares are pooled over hinges if there are any.
    """
    if outcome.learned is not None:
        return outcome.learned.shares
    places = select_first_kind(held)
    floor = float((held.mean_floor[places] ** 2).mean())
    before, after = (
        float(held.evidence.mean_squares(predicted.positions)[:, places].mean())
        for predicted in (outcome.before, outcome.after)
    )
    above_floor = max(before - floor, 1e-18)
    left = float(np.clip((after - floor) / above_floor, 0.0, 1.0))
    return Shares(names=1 - left, left=left)


def select_first_kind(held: FitTask) -> np.ndarray:
    """Return the indices of the joints over which errors are pooled: hinges if there are any."""
    return group_by_kind(held.evidence.joints, held.nominal.slides)[0][1]


def describe_placebo(held: FitTask, naming: Naming) -> Placebo | None:
    """Return the error of the runner-up in place of the finding with the highest confidence."""
    if naming.placebo is None:
        return None
    error = float(np.sqrt(naming.placebo.heldout[:, select_first_kind(held)].mean()))
    rival = naming.placebo.effects[-1]
    replaced = next(finding.effect for finding in naming.findings if finding.best_rival is naming.placebo)
    effects = (effect.to_json(held.nominal.slides) for effect in naming.placebo.effects)
    return Placebo(
        effects=tuple(from_json(FittedEffect, entry) for entry in effects),
        after=error,
        text=f"{name_with_place(rival)} instead of {name_with_place(replaced)}",
    )


def name_with_place(effect: Effect) -> str:
    """Return an effect's name with its joint, or with the whole arm: rivals may differ in the place alone."""
    return f"{effect.name()} in {effect.joint or 'the whole arm'}"


def write_series(folder: Path, problem: Problem, naming: Naming, outcome: HeldOutResult) -> None:
    """Write the held-out episodes and all predictions to `series.npz`."""
    held = problem.held
    evidence = held.evidence
    series = {
        "time": evidence.period * np.arange(1, evidence.commands.shape[1] + 1),
        "joints": np.array(evidence.joints),
        "episodes": problem.number_episodes(evidence),
        "measured": evidence.measured,
        "command": evidence.commands,
        "before": outcome.before.positions,
        "retuned": outcome.retuned.positions,
        "after": outcome.after.positions,
        "counts": evidence.mask,
        "floor": held.mean_floor,
        "slides": np.array(held.nominal.slides, dtype=str),
    }
    if outcome.plain.is_finite:
        series["plain"] = outcome.plain.positions
    if naming.placebo is not None:
        predicted = held.predict(naming.placebo.fit.parameters, naming.placebo.fit.theta)
        if predicted is not None:
            series["placebo"] = predicted
    np.savez_compressed(folder / SERIES, allow_pickle=False, **series)
