"""Naming of effects, with confidence and alternatives."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import zip_longest

import numpy as np
from threadpoolctl import threadpool_limits

from nas_data.effects.base import Effect
from nas_data.gap.confidence import Support, measure_support
from nas_data.gap.delay_range import find_delay_range
from nas_data.gap.rivals import Rival, compute_closeness
from nas_data.gap.search.choose import choose
from nas_data.gap.search.constants import MAX_ALTERNATIVES, PRICE
from nas_data.gap.search.contrast import Contrast
from nas_data.gap.search.final import FinalFit, compute_conditioning, find_at_bound, fit_final
from nas_data.gap.search.firm_friction import make_friction_firm
from nas_data.gap.search.hypothesis import Description, Hypothesis, effect_key
from nas_data.gap.search.moves.add import fit_worst_joints
from nas_data.gap.search.moves.replace_by_rival import fit_rivals
from nas_data.gap.search.objective import FitTask
from nas_data.gap.search.search import Search
from nas_data.gap.search.tie_break import break_tie
from nas_data.joint_units import group_by_kind

SURE_CONFIDENCE = 0.8  # confidence below which an experiment is proposed
UNEXPLAINED_FLOORS = 3.0  # noise floors above which a joint may be unexplained
UNEXPLAINED_SHARE = 0.75  # share of the error before above which such a joint is unexplained


@dataclass(frozen=True)
class Finding:
    """One named effect.

    Attributes:
        effect: Effect with fitted parameters.
        interval: 95 % confidence interval of each parameter.
        episode_range: Smallest and largest value of single episodes, of parameters that differ between them.
        support: What name and joint rest on.
        before: Held-out error without the effect and everything else fitted again [rad; slides m]: of its joint, or of
            the joints of the first kind for an effect of the whole arm.
        after: The same with the effect.
        rivals: Fitted rivals by score, equivalent ones after them, its absence last.
    """

    effect: Effect
    interval: Mapping[str, tuple[float, float]]
    support: Support
    before: float
    after: float
    rivals: tuple[Rival, ...] = ()
    episode_range: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    @property
    def confidence(self) -> float:
        """Probability that name and joint are right."""
        return self.support.confidence

    @property
    def best_rival(self) -> Hypothesis | None:
        """Hypothesis with the best effect in its place that is not equivalent; None without rivals."""
        fitted = (rival.hypothesis for rival in self.rivals if rival.effect and not rival.is_equivalent)
        return next(fitted, None)

    @property
    def doubts(self) -> list[Hypothesis]:
        """Rivals that this recording cannot exclude, closest first; the closest if it can exclude all."""
        real = sorted((rival for rival in self.rivals if not rival.is_equivalent), key=lambda rival: -rival.closeness)
        return [rival.hypothesis for rival in [one for one in real if one.is_equal] or real[:1]]


@dataclass(frozen=True)
class Naming:
    """Result of the search.

    Attributes:
        findings: Named effects, highest confidence first.
        final: Final fit to all training episodes.
        null: Model's own parameters fitted, no effects.
        plain: Plain fit.
        description: Structure of the final fit.
        plain_description: Structure of the plain fit.
        stable: Whether two halves of the recording agree, by joint; see `final.compare_halves`.
        candidates: If nothing is named although a gap remains, hypotheses with one effect that is not worth its price
            yet, best first.
    """

    findings: tuple[Finding, ...]
    final: FinalFit
    null: FinalFit
    plain: FinalFit
    description: Description
    plain_description: Description
    stable: Mapping[str, bool]
    candidates: tuple[Hypothesis, ...] = ()

    def with_fit(self, final: FinalFit) -> "Naming":
        """Return the same names with the parameters of another fit that contains them."""
        numbers = {effect_key(effect): number for number, effect in enumerate(final.effects)}
        findings = tuple(
            replace(finding, effect=final.effects[number], interval=final.intervals[number])
            for finding in self.findings
            if (number := numbers.get(effect_key(finding.effect))) is not None
        )
        return replace(self, findings=findings, final=final)

    @property
    def placebo(self) -> Hypothesis | None:
        """Best rival of the finding with the highest confidence; None without rivals."""
        return next((one.best_rival for one in self.findings if one.best_rival), None)

    @property
    def surviving_rivals(self) -> list[Hypothesis]:
        """Doubts about the findings with a confidence below `SURE_CONFIDENCE`, lowest first, at most three.

        The closest doubt about each comes first, then the next.
        """
        unsure = sorted((one for one in self.findings if one.confidence < SURE_CONFIDENCE), key=lambda f: f.confidence)
        ranks = zip_longest(*(finding.doubts for finding in unsure))
        return [h for rank in ranks for h in rank if h is not None][:MAX_ALTERNATIVES]


@threadpool_limits.wrap(limits=1, user_api="blas")  # idle BLAS threads would occupy cores of the rollouts
def name(
    train: FitTask,
    held: FitTask,
    say: Callable[[str], None] = lambda text: None,
    contrast: Contrast | None = None,
) -> Naming:
    """Search for missing effects and assess every name.

    Args:
        train: Model and training episodes.
        held: Model and held-out episodes.
        say: Receives progress messages.
        contrast: Recording without the change to be named, if there is one.
    """
    search = Search.begin(train, held, say, contrast)
    choice = choose(search)
    plain = choice.plain
    baseline = FinalFit(
        plain.effects,
        plain.fit.factors,
        (),
        choice.plain_fine,
        find_at_bound(plain.fit),
        compute_conditioning(search.task, plain.fit),
    )
    train = replace(search.train, fine=search.task.fine)
    kept = withdraw(search, choice.best)
    say("comparing candidates with similar scores")
    kept = break_tie(search, train, kept)
    kept, firm = make_friction_firm(search, kept)
    train = replace(search.train, fine=search.task.fine)
    null = FinalFit((), search.null.fit.factors, ())
    say("last fit, on all training episodes")
    final = fit_final(train, kept.description, kept.fit.factors)
    findings = []
    for number, effect in enumerate(kept.effects):
        say(f"checking {effect.name()} at {effect.joint or 'the arm'}, {number + 1} of {len(kept.effects)}")
        findings.append(assess(search, kept, final, number))
    findings.sort(key=lambda finding: -finding.confidence)
    final = replace(final, factors={**final.factors, **firm})
    return Naming(
        tuple(findings),
        final,
        null,
        baseline,
        kept.description,
        plain.description,
        final.stable,
        find_candidates(search, kept),
    )


def find_candidates(search: Search, kept: Hypothesis) -> tuple[Hypothesis, ...]:
    """Return hypotheses with one effect that falls short of its price by less than that, if nothing is named."""
    ranked = [] if kept.effects else fit_worst_joints(search, kept)
    return tuple(h for h in ranked if h.score.over(kept.score) < PRICE)[:MAX_ALTERNATIVES]


def withdraw(search: Search, kept: Hypothesis) -> Hypothesis:
    """Remove names in joints that stay mostly unexplained, because their cause is not in the catalogue."""
    rest, null = search.floor_ratios(kept), search.floor_ratios(search.null)
    joints = zip(search.train.nominal.joints, rest, null, strict=True)
    unknown = {
        joint for joint, left, before in joints if left > UNEXPLAINED_FLOORS and left > UNEXPLAINED_SHARE * before
    }
    sound = tuple(effect for effect in kept.effects if effect.local_joint not in unknown)
    if len(sound) == len(kept.effects):
        return kept
    left = {effect.name() for effect in sound}
    description = Description(sound, kept.description.freed, kept.description.shared & left)
    other = search.fit_rival(description, kept) if sound else search.null
    if other is None:
        return kept
    search.report(f"{', '.join(sorted(unknown))} not explained by any effect", other)
    return other


def assess(search: Search, kept: Hypothesis, final: FinalFit, number: int) -> Finding:
    """Compare one effect with its absence and its rivals."""
    effect = kept.effects[number]
    joints = select_joints(search, effect)
    stable = final.stable.get(effect.local_joint) if effect.local_joint else None

    def rate(h: Hypothesis, effect: Effect | None = None, is_equivalent: bool = False) -> Rival:
        return Rival(h, effect, compute_closeness(search, kept, h), rms(h.heldout, joints), is_equivalent)

    without = fit_without(search, kept, number)
    rivals = (
        *(rate(h, h.effects[-1]) for h in fit_rivals(search, kept, number)),
        *(rate(h, h.effects[-1], is_equivalent=True) for h in fit_equivalents(search, kept, number)),
        rate(without),
    )
    return Finding(
        effect=final.effects[number],
        interval=final.intervals[number],
        support=measure_support(search, kept, effect, without, rivals, joints, stable),
        before=rivals[-1].error,
        after=rms(kept.heldout, joints),
        rivals=rivals,
        episode_range=find_delay_range(
            replace(search.train, fine=final.fine), final.effects, dict(final.factors), number
        ),
    )


def fit_without(search: Search, kept: Hypothesis, number: int) -> Hypothesis:
    """Fit the hypothesis without an effect; return the given model if that diverges."""
    fewer = (search.without_effect(kept, number), search.null, search.nominal)  # the last never diverges
    return next(h for h in fewer if h and h.is_finite)


def fit_equivalents(search: Search, kept: Hypothesis, number: int) -> list[Hypothesis]:
    """Fit the hypothesis with effects in the place of one that no data could distinguish from it."""
    effect, rest = kept.effects[number], kept.description.without_effect(number)
    twins = effect.equivalents(search.find_scales(effect.joint)) if effect.joint else ()
    fitted = (search.fit_rival(rest.add_effects(twin), kept) for twin in twins)
    return [h for h in fitted if h and h.is_finite]


def select_joints(search: Search, effect: Effect) -> list[int]:
    """Return the indices of the joints that judge an effect: its own, or all of the first kind."""
    joints = search.train.nominal.joints
    if effect.local_joint is not None:
        return [joints.index(effect.local_joint)]
    return group_by_kind(joints, search.train.nominal.slides)[0][1].tolist()


def rms(heldout: np.ndarray, joints: Sequence[int]) -> float:
    """Return the error over some joints of one kind [rad; m] from mean squares (E, n)."""
    return float(np.sqrt(heldout[:, joints].mean()))
