"""Name the effects: what was found, how sure, what came second."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from nas_data.effects.base import Effect
from nas_data.gap.search.choose import choose
from nas_data.gap.search.final import FinalFit, fit_final
from nas_data.gap.search.hypothesis import Description, Hypothesis, effect_key
from nas_data.gap.search.moves.replace_by_rival import fit_rivals
from nas_data.gap.search.objective import FitTask
from nas_data.gap.search.plain_fit import fit_plain
from nas_data.gap.search.search import Search
from nas_data.gap.search.tie_break import break_tie
from nas_data.joint_units import kinds_of

SHARPNESS = 4.0  # how fast doubt falls with the ratio of the runner-up's error to the winner's
SURE = 0.8  # confidence below which an experiment is proposed that would decide
ALIKE = 0.8  # closeness of a rival, 1 where it predicts as well, from which the data cannot tell it from the winner
POOR = 3.0  # noise floors of rest above which a joint may be called unexplained
UNEXPLAINED = 0.75  # part of a joint's error that must stay, for it to be called so
ROUGH = 2.0  # noise floors of rest above which a name is doubted
ADEQUATE = 1.5  # noise floors of rest up to which a joint counts as explained


@dataclass(frozen=True)
class Finding:
    """One named effect.

    Attributes:
        effect: With fitted parameters.
        interval: Lowest and highest value of each parameter, 95 %.
        confidence: Probability that name and joint are right.
        before: Held-out error of its joint (of the joints of the first kind for the arm's effects) without it, the rest
            fitted anew [rad; slides m].
        after: The same with it.
        alternatives: What came second and after in its place, with their held-out error.
        equals: Those of them that these data cannot tell from it. One that no data could tell from it (its twin) costs
            no confidence.
    """

    effect: Effect
    interval: Mapping[str, tuple[float, float]]
    confidence: float
    before: float
    after: float
    alternatives: tuple[tuple[Effect, float], ...]
    equals: tuple[Effect, ...] = ()


@dataclass(frozen=True)
class Naming:
    """What the search named.

    Attributes:
        findings: Effects, the surest first.
        final: Last fit, on all training episodes.
        null: The model's own parameters fitted a few percent, with nothing added.
        plain: The plain fit: every smooth parameter free, with no name given.
        rivals: For each finding, the fitted hypothesis with its runner-up in its place, or None.
        description: What is assumed where the effects are named.
        plain_description: What the plain fit assumes.
        stable: Of which joints two halves of the recording agree on the effects' parameters; see `final.stability`.
    """

    findings: tuple[Finding, ...]
    final: FinalFit
    null: FinalFit
    plain: FinalFit
    rivals: tuple[Hypothesis | None, ...]
    description: Description
    plain_description: Description
    stable: Mapping[str, bool]

    def refitted(self, final: FinalFit) -> "Naming":
        """Return the same names with the parameters of another fit, which holds them and more."""
        numbers = {effect_key(effect): number for number, effect in enumerate(final.effects)}
        findings = [
            replace(finding, effect=final.effects[number], interval=final.intervals[number])
            for finding in self.findings
            if (number := numbers.get(effect_key(finding.effect))) is not None
        ]
        return replace(self, findings=tuple(findings), final=final, rivals=self.rivals[: len(findings)])

    @property
    def placebo(self) -> Hypothesis | None:
        """The runner-up of the surest finding in its place; None where nothing came second."""
        return next((rival for rival in self.rivals if rival is not None), None)

    @property
    def doubt(self) -> Hypothesis | None:
        """The runner-up of the least sure finding, where that is not sure; None where all are."""
        unsure = [
            (finding.confidence, rival)
            for finding, rival in zip(self.findings, self.rivals, strict=True)
            if finding.confidence < SURE and rival is not None
        ]
        return min(unsure, key=lambda pair: pair[0])[1] if unsure else None


@threadpool_limits.wrap(limits=1, user_api="blas")  # it would wait busily on the cores that the rollouts need
def name(train: FitTask, held: FitTask, say: Callable[[str], None] = lambda text: None) -> Naming:
    """Search for the missing effects and judge every name.

    Args:
        train: Model and training episodes.
        held: Model and held-out episodes.
        say: Told what is going on.
    """
    search = Search.begin(train, held, say)
    first = search.current_round
    plain, fine = fit_plain(search), search.task.fine
    search.return_to(first)
    train = replace(search.train, fine=search.task.fine)
    kept = withdraw(search, choose(search, plain))
    say("comparing what is nearly as good")
    kept = break_tie(search, train, kept)
    null = FinalFit((), search.null.fit.factors, ())
    say("last fit, on all training episodes")
    final = fit_final(train, kept.description, kept.fit.factors)
    judged = []
    for number, effect in enumerate(kept.effects):
        say(f"judging {effect.name()} at {effect.joint or 'the arm'}, {number + 1} of {len(kept.effects)}")
        judged.append(judge(search, kept, final, number))
    order = sorted(range(len(judged)), key=lambda number: -judged[number][0].confidence)
    findings, rivals = [judged[number][0] for number in order], [judged[number][1] for number in order]
    baseline = FinalFit(plain.effects, plain.fit.factors, (), fine)
    return Naming(
        tuple(findings), final, null, baseline, tuple(rivals), kept.description, plain.description, final.stable
    )


def withdraw(search: Search, kept: Hypothesis) -> Hypothesis:
    """Take back the names in joints of which most stays unexplained: their cause is not in the catalogue."""
    rest, null = search.floor_ratios(kept), search.floor_ratios(search.null)
    joints = zip(search.train.nominal.joints, rest, null, strict=True)
    unknown = {joint for joint, left, before in joints if left > POOR and left > UNEXPLAINED * before}
    sound = tuple(effect for effect in kept.effects if effect.joint not in unknown)
    if len(sound) == len(kept.effects):
        return kept
    left = {effect.name() for effect in sound}
    description = Description(sound, kept.description.freed, kept.description.shared & left)
    other = search.fit_rival(description, kept) if sound else search.null
    if other is None:
        return kept
    search.report(f"{', '.join(sorted(unknown))} not explained by any effect", other)
    return other


def judge(search: Search, kept: Hypothesis, final: FinalFit, number: int) -> tuple[Finding, Hypothesis | None]:
    """Compare one effect with nothing and with its rivals; return the finding and the best rival's hypothesis."""
    effect = kept.effects[number]
    rest = kept.description.without_effect(number)
    fewer = (
        search.without_effect(kept, number),
        search.null,
        search.nominal,
    )  # of which the last runs on every episode
    without = next(h for h in fewer if h and h.is_finite)
    ranked = fit_rivals(search, kept, number)
    twins = [
        h
        for twin in effect.equivalents(effect.joint)
        if (h := search.fit_rival(rest.add_effects(twin), kept)) and h.is_finite
    ]
    joints = judged_joints(search, effect)
    confidence = surety(search, kept, ranked, without)
    finding = Finding(
        effect=final.effects[number],
        interval=final.intervals[number],
        confidence=confidence,
        before=rms(without.heldout, joints),
        after=rms(kept.heldout, joints),
        alternatives=tuple((h.effects[-1], rms(h.heldout, joints)) for h in [*ranked, *twins]),
        equals=tuple(h.effects[-1] for h in [*ranked, *twins] if closeness(search, kept, h) >= ALIKE),
    )
    return finding, ranked[0] if ranked else None


def judged_joints(search: Search, effect: Effect) -> list[int]:
    """Return the indices of the joints by which an effect is judged: its own, or all of the arm's first kind."""
    joints = search.train.nominal.joints
    if effect.joint is not None:
        return [joints.index(effect.joint)]
    return kinds_of(joints, search.train.nominal.slides)[0][1].tolist()


def rms(heldout: np.ndarray, joints: Sequence[int]) -> float:
    """Return the error over some joints of one kind [rad; slides m] from mean squares (E, n)."""
    return float(np.sqrt(heldout[:, joints].mean()))


def surety(search: Search, kept: Hypothesis, ranked: Sequence[Hypothesis], without: Hypothesis) -> float:
    """Return the confidence in a name: how far its best rival is behind, and how little is left.

    A rival as good as the winner leaves one half; how true it is, the blind benchmark tells.
    """
    best = max(closeness(search, kept, other) for other in [*ranked, without])
    rest = float(search.floor_ratios(kept).max())
    return round(float((1 - 0.5 * best) * min(1.0, (ROUGH / rest) ** 0.5 if rest > ROUGH else 1.0)), 3)


def closeness(search: Search, kept: Hypothesis, rival: Hypothesis) -> float:
    """Return how near a rival comes: 1 where it predicts held-out episodes as well in every joint, 0 far behind."""
    lead = float(search.log_error_ratios(rival, kept).mean(0).min())
    return min(1.0, math.exp(SHARPNESS * lead))
