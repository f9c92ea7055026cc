"""Delivery: write the model with the named effects, or one that predicts better."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from nas_data.effects.base import Effect
from nas_data.gap.floor import compute_floor_ratios
from nas_data.gap.name import Naming
from nas_data.gap.problem import Problem
from nas_data.gap.score_model import HeldOutResult, Prediction, predict_held, score_model
from nas_data.gap.search.constants import ERROR_SHARE, EXPLAINED
from nas_data.gap.search.final import MAX_RATIO, ROUNDS, FinalFit, fit_final
from nas_data.gap.search.hypothesis import Description, effect_key
from nas_data.gap.search.plain_fit import convert_parameter
from nas_data.gap.write_model import write_effects
from nas_data.joint_units import average_by_kind
from nas_data.runs.progress import Report

Delivered = tuple[Naming, HeldOutResult]


def deliver(problem: Problem, naming: Naming, folder: Path, say: Report) -> Delivered:
    """Write the model with the named effects, or a better one if the plain fit or given model predicts better.

    The file of the named effects is accepted if it reaches the noise floor, or the better of plain fit and given model.
    Else other models are tried in order, and the first that is accepted is written.
    """
    found = Delivery(problem, naming, folder, score_model(problem, naming.final, naming.null, naming.plain, folder))
    if found.accepts(found.outcome.written):
        return naming, found.outcome
    say("the written names predict held-out episodes worse than the plain fit or the model as given")
    attempts = (
        fit_with_fine_steps,
        fit_expressible_parts,
        keep_written_names,
        add_plain_fit,
        write_plain_fit,
        keep_confirmed_names,
    )
    for attempt in attempts:
        if delivered := attempt(found):
            return delivered
    return leave_names_out(found)


@dataclass(frozen=True)
class Delivery:
    """Named effects with their score, in whose place another model may be delivered.

    Attributes:
        problem: Recording and model.
        naming: Named effects.
        folder: Folder of the report.
        outcome: Predictions of the models with the names as found.
    """

    problem: Problem
    naming: Naming
    folder: Path
    outcome: HeldOutResult

    def accepts(self, predicted: Prediction) -> bool:
        """Whether predictions reach the noise floor, or the better of plain fit and given model."""
        at_floor = compute_floor_ratios(predicted.squares, self.problem.held.floors).max() <= EXPLAINED
        return bool(at_floor) or self.rms(predicted) <= min(self.rms(self.outcome.plain), self.rms(self.outcome.before))

    def rms(self, predicted: Prediction) -> float:
        """Return the held-out error over all joints, each divided by its noise floor or that of its kind."""
        held = self.problem.held
        scales = average_by_kind(held.mean_floor, held.evidence.joints, held.nominal.slides)
        return float(np.sqrt((predicted.squares / scales**2).mean()))

    def rest(self, predicted: Prediction) -> float:
        """Return the RMS over joints of the held-out error over the noise floor, which one episode cannot dominate."""
        return float(np.sqrt((compute_floor_ratios(predicted.squares, self.problem.held.floors) ** 2).mean()))

    def score(self, final: FinalFit) -> HeldOutResult:
        """Write and score another model."""
        return score_model(self.problem, final, self.naming.null, self.naming.plain, self.folder)

    def fit(
        self,
        description: Description,
        factors: Mapping[str, float],
        fine: bool,
        rounds: int = ROUNDS,
        intervals: bool = True,
    ) -> FinalFit:
        """Fit another description to the training episodes, with finer physics steps or without; see `fit_final`."""
        return fit_final(replace(self.problem.train, fine=fine), description, dict(factors), rounds, intervals)

    def deliver_with_names(self, other: HeldOutResult) -> Delivered:
        """Return another model with the names as found, which `effects.json` then holds."""
        final = self.naming.final
        write_effects(self.folder, final.effects, final.factors, self.problem.held.nominal, other.contains)
        after = self.outcome.after
        return self.naming, replace(other, after=after if after.is_finite else other.written)

    @property
    def names(self) -> Description:
        """Description of the named effects at their fitted values."""
        return self.naming.description.with_effects(self.naming.final.effects)

    @property
    def has_hooks(self) -> bool:
        """Whether a named effect needs a hook in simulation."""
        return not all(effect.in_model for effect in self.naming.final.effects)

    @cached_property
    def with_plain(self) -> Description:
        """Description of the named effects with everything that the plain fit changes."""
        return self.names.merge(self.naming.plain_description)

    @cached_property
    def factors_with_plain(self) -> dict[str, float]:
        """Initial factors for `with_plain`: the plain fit's, and those of the names where it frees nothing."""
        bound = {name: f for name, f in self.naming.final.factors.items() if name not in self.with_plain.freed}
        return {**self.naming.plain.factors, **bound}


def fit_with_fine_steps(found: Delivery) -> Delivered | None:
    """Fit the names with finer physics steps, if they have effects that a file expresses only with fine steps."""
    final = found.naming.final
    if not found.has_hooks or final.fine:
        return None
    fine = found.fit(found.names, final.factors, fine=True, rounds=1)
    outcome = found.score(fine)
    return (found.naming.with_fit(fine), outcome) if found.accepts(outcome.written) else None


def fit_expressible_parts(found: Delivery) -> Delivered | None:
    """Write the names as a fit without what no file expresses, such as the fall of friction under load with speed."""
    final = found.naming.final
    parts = [effect.expressible_part() for effect in final.effects]
    if parts == list(final.effects):
        return None
    outcome = found.score(found.fit(found.names.with_effects(parts), final.factors, fine=True, intervals=False))
    return found.deliver_with_names(replace(outcome, expresses_all=False)) if found.accepts(outcome.written) else None


def keep_written_names(found: Delivery) -> Delivered | None:
    """Write the names that MJCF expresses with the changes of the plain fit, if all names simulate well enough."""
    if not found.has_hooks or not found.accepts(found.outcome.after):
        return None
    final = found.naming.final
    part = found.fit(select_written_effects(found.with_plain), found.factors_with_plain, final.fine, intervals=False)
    if not found.accepts(predict_held(found.problem, part)):
        return None
    return found.deliver_with_names(
        replace(found.score(part), expresses_all=False, delivered="names of MJCF and plain")
    )


def add_plain_fit(found: Delivery) -> Delivered | None:
    """Write all names with the changes of the plain fit."""
    if not found.naming.findings:
        return None
    together = found.fit(found.with_plain, found.factors_with_plain, found.naming.final.fine)
    if not found.accepts(predict_held(found.problem, together)):
        return None
    return found.naming.with_fit(together), replace(found.score(together), delivered="names and plain")


def write_plain_fit(found: Delivery) -> Delivered | None:
    """Write the plain fit, and keep the names, if they predict nearly as well in all episodes or in most.

    Where an error is not at the noise floor, for example because it grows from the start of an episode, a small
    difference between two models is no evidence against the simpler one.
    """
    outcome = found.outcome
    near = any(error(outcome.after) <= (1 + ERROR_SHARE) * error(outcome.plain) for error in (found.rms, found.rest))
    if not found.naming.findings or not near or found.rms(outcome.plain) > found.rms(outcome.before):
        return None
    return found.deliver_with_names(replace(found.score(found.naming.plain), delivered="plain"))


def keep_confirmed_names(found: Delivery) -> Delivered | None:
    """Write the plain fit, with the names that it confirms, if there are any.

    A name is confirmed if the plain fit has it too, as an effect or as a changed parameter, with a similar value.
    """
    plain, spec = found.naming.plain, found.problem.train.nominal.spec
    if found.rms(found.outcome.plain) > found.rms(found.outcome.before):
        return None
    freed = {name: convert_parameter(spec, name, plain.factors[name]) for name in found.naming.plain_description.freed}
    known = {effect_key(effect): effect for effect in (*plain.effects, *filter(None, freed.values()))}
    named = {effect_key(effect): effect for effect in found.naming.final.effects}
    confirmed = {key: known[key] for key in named if key in known and are_similar(named[key], known[key])}
    if not confirmed:
        return None
    replaced = {name: effect for name, effect in freed.items() if effect and effect_key(effect) in confirmed}
    factors = {name: factor for name, factor in plain.factors.items() if name not in replaced}
    naming = found.naming.with_fit(found.naming.final.with_values(confirmed))
    naming = replace(naming, final=replace(plain, effects=(*plain.effects, *replaced.values()), factors=factors))
    return naming, replace(found.score(naming.final), delivered="names and plain")


def are_similar(effect: Effect, other: Effect) -> bool:
    """Whether the first parameters of two effects agree within the largest ratio of two halves."""
    first = effect.parameters[0].name
    ratio = getattr(effect, first) / getattr(other, first)
    return 1 / MAX_RATIO <= ratio <= MAX_RATIO


def leave_names_out(found: Delivery) -> Delivered:
    """Write the better of plain fit and given model, without names."""
    is_plain = found.rms(found.outcome.plain) <= found.rms(found.outcome.before)
    final = found.naming.plain if is_plain else FinalFit((), {}, (), fine=False)
    problem = found.problem if is_plain else found.problem.with_contacts()
    outcome = replace(found, problem=problem).score(final)
    nameless = replace(found.naming, findings=(), final=final)
    return nameless, replace(outcome, delivered="plain" if is_plain else "given")


def select_written_effects(description: Description) -> Description:
    """Return the description without the effects that a model file does not express by itself."""
    effects = tuple(effect for effect in description.effects if effect.in_model)
    names = {effect.name() for effect in effects}
    return replace(description, effects=effects, shared=description.shared & names)
