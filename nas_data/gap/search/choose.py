"""Choose the effects: add what helps, several joints at once, then drop what held-out episodes do not need."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from nas_data.effects.base import Effect, find_effect
from nas_data.gap.search.fit import Fit, Task, fit, slopes
from nas_data.gap.search.hypothesis import Hypothesis, Place, lent_slopes, lively, place, shortened, strained
from nas_data.gap.search.scales import scales
from nas_data.gap.search.screen import Candidate, screen
from nas_data.gap.search.unknowns import Unknowns, free_base

SCREENED = 6  # episodes on which candidates are compared
SCREENED_ROWS = 1800  # rows on which they are compared at least, where episodes are short
FINALISTS = 3  # short fits that are continued
MOST = 12  # effects in one arm
AT_FLOOR = 1.15  # noise floors below which nothing is looked for
UNSATISFIED = 1.25  # noise floors above which other effects are tried in the place of one that was found
BUNDLED = 2  # effects that are tried in all joints at once
SIMPLER = 2  # effects of fewer parameters that are tried in the place of one
EXCHANGED = 4  # of them
PROMISE = 2.5  # nats by which the first order must lower the loss of every other episode, or a candidate is not fitted
SLACK = 30.0  # nats that the first order may be wrong by there around the unfitted model
FAR_BEHIND = 60.0  # nats by which a rival may lie behind after a few steps and still be fitted to the end
CHANCE = 80.0  # nats by which a short fit may lie behind the best and still be continued
GAIN = 12.0  # nats by which an added effect must lower the loss on fitted episodes
NOTICEABLE = 0.95  # held-out error of the most improved joint below which an effect is added for now
PLAUSIBLE = 12.0  # nats by which an effect may lower the loss instead, by what it spares the base
BETTER = 0.90  # held-out error of the most improved joint, with over without the effect
MUCH_BETTER = 0.80  # the same where much of that joint's error stays: something else is there
WINS = 0.75  # share of held-out episodes in which the effect must help
MARK = 2.0  # noise floors that an effect must move a joint by, or it is too small to be named

POOR = 3.0  # noise floors of rest above which a joint may be called unexplained
UNEXPLAINED = 0.5  # part of a joint's error that must stay, for it to be called so


def worth(h: Hypothesis) -> float:
    """Return the loss with what each effect has to lower it by."""
    return h.loss + GAIN * len(h.effects)


@dataclass
class Search:
    """The search for missing effects in one dataset.

    Attributes:
        train: Model and training episodes.
        held: Model and held-out episodes.
        say: Told what is going on.
        rivals: For each place, effects that competed with it when it was added.
        settled: Sets of effects in which exchanges were tried.
        fewer: What was fitted with one effect fewer, by the effects and the number of the one left out.
    """

    train: Task
    held: Task
    say: Callable[[str], None] = lambda text: None
    rivals: dict[Place, list[Effect]] = field(default_factory=dict)
    settled: set[frozenset[Place]] = field(default_factory=set)
    fewer: dict[tuple[tuple[Effect, ...], int], Hypothesis | None] = field(default_factory=dict)

    def __post_init__(self) -> None:
        count, steps = self.train.evidence.commands.shape[:2]
        wanted = max(SCREENED, SCREENED_ROWS // steps)
        chosen = np.unique(np.linspace(0, count - 1, min(count, wanted)).round().astype(int))
        self.sub = self.train.select(chosen).corrected((), {})
        self.held = self.held.corrected((), {})
        unknowns = Unknowns((), self.train.nominal.base)
        start = unknowns.start()
        predicted = self.sub.predict(unknowns, start)
        assert predicted is not None, "the model was rolled out before"
        grad = slopes(self.sub, unknowns, start, predicted, range(unknowns.size))
        self.nominal = self.judged(Fit(unknowns, start, predicted, self.sub.misfit(predicted), grad))
        self.sizes = scales(self.train.nominal, self.sub.evidence, predicted)
        self.lively = lively(self.train)
        null = self.fitted((), {}, self.nominal.fit, steps=8, renewals=1)
        self.null = self.nominal if null is None or null.loss > self.nominal.loss else null
        self.report("base alone", self.null)

    def judged(self, found: Fit) -> Hypothesis:
        """Roll a fit out on the held-out episodes."""
        predicted = self.held.predict(found.unknowns, found.numbers)
        if predicted is None:
            return Hypothesis(found, np.full((len(self.held.evidence), len(self.held.floor)), np.inf))
        return Hypothesis(found, self.held.evidence.mean_squares(predicted))

    def fitted(
        self,
        effects: Sequence[Effect],
        factors: dict[str, float],
        near: Fit | None = None,
        steps: int = 6,
        renewals: int = 0,
    ) -> Hypothesis | None:
        """Fit a set of effects from guesses; `near` lends its slopes by the base. None where the model diverges."""
        unknowns = Unknowns(tuple(effects), free_base(self.train.nominal.base, effects))
        found = fit(self.sub, unknowns, unknowns.start(factors), lent_slopes(near, unknowns), steps, renewals)
        return None if found is None else self.judged(found)

    def rival(self, effects: Sequence[Effect], kept: Hypothesis, steps: int = 4) -> Hypothesis | None:
        """Fit other effects in the place of those kept, thoroughly where they come near."""
        found = self.fitted(effects, kept.fit.factors, kept.fit, steps)
        return found if found is None or found.loss > kept.loss + FAR_BEHIND else self.continued(found)

    def run(self) -> Hypothesis:
        """Search and return the hypothesis that is kept."""
        kept, around = self.null, self.nominal.fit
        if not self.lively:
            return kept
        while len(kept.effects) < MOST and (self.ratio(kept).max() > AT_FLOOR or strained(kept)):
            grown = self.grown(kept, self.extensions(kept, around))
            if grown is None:
                break
            kept = self.exchanged(self.refined(grown))
            self.report("added", kept)
            around = kept.fit
        return self.pruned(self.adequate(self.simplified(self.pruned(kept))))

    def simplified(self, kept: Hypothesis) -> Hypothesis:
        """Put an effect of fewer parameters in the place of each that needs its more of them hardly at all."""
        for number, effect in enumerate(kept.effects):
            simpler = [find_effect(name) for name in effect.confused_with]
            names = {kind.name() for kind in simpler if len(kind.parameters) < len(effect.parameters)}
            rest = self.without(kept, number) if names and effect.joint else None
            if rest is None or effect.joint is None:
                continue
            found, _ = self.screened(rest.fit, rest, {effect.joint})
            chosen = [c for c in found if c.effect.name() in names and c.effect.joint == effect.joint][:SIMPLER]
            fitted = [self.fitted((*rest.effects, c.effect), c.factors, rest.fit, renewals=1) for c in chosen]
            for other in sorted((h for h in fitted if h), key=lambda h: h.loss):
                if np.exp(self.logs(other, kept).mean(0).min()) > NOTICEABLE:
                    self.rivals.setdefault(place(other.effects[-1]), []).append(effect)
                    self.report(f"{effect.name()} simplified", other)
                    return self.simplified(other)
        return kept

    def adequate(self, kept: Hypothesis) -> Hypothesis:
        """Take back the names in joints of which most stays unexplained: their cause is not in the catalogue."""
        rest, null = self.ratio(kept), self.ratio(self.judged(self.null.fit))
        joints = zip(self.train.nominal.joints, rest, null, strict=True)
        unknown = {joint for joint, left, before in joints if left > POOR and left > UNEXPLAINED * before}
        sound = tuple(effect for effect in kept.effects if effect.joint not in unknown)
        if len(sound) == len(kept.effects):
            return kept
        other = self.fitted(sound, kept.fit.factors, kept.fit, steps=4) if sound else self.judged(self.null.fit)
        if other is None:
            return kept
        self.report(f"{', '.join(sorted(unknown))} not explained by any effect", other)
        return other

    def extensions(self, kept: Hypothesis, around: Fit) -> list[Hypothesis]:
        """Return the hypotheses that one more effect makes, best first."""
        ratios = zip(self.train.nominal.joints, self.ratio(kept), strict=True)
        wanted = {joint for joint, ratio in ratios if ratio > AT_FLOOR} | strained(kept)
        wanted &= self.lively
        found, reach = self.screened(around, kept, wanted)
        shortlist = shortened(found, reach - PROMISE, SLACK if around is self.nominal.fit else 0.0)
        quick = [self.fitted((*around.effects, c.effect), c.factors, around, steps=2) for c in shortlist]
        ranked = sorted((h for h in quick if h), key=lambda h: h.loss)
        ahead = [h for h in ranked if h.loss < ranked[0].loss + CHANCE][:FINALISTS]
        ranked = sorted([*map(self.continued, ahead), *ranked[len(ahead) :]], key=lambda h: h.loss)
        ranked = sorted([*ranked, *self.bundles(kept, ranked, found, reach, around)], key=worth)
        for h in ranked[:4]:
            self.report("  tried", h)
        return ranked

    def bundles(
        self, kept: Hypothesis, ranked: Sequence[Hypothesis], found: Sequence[Candidate], reach: float, around: Fit
    ) -> list[Hypothesis]:
        """Return what the best effects do in all joints at once: servos of one make lack the same."""
        names = dict.fromkeys(h.effects[-1].name() for h in ranked if h.effects[-1].joint and kept.loss - h.loss > GAIN)
        chosen = []
        for name in list(names)[:BUNDLED]:
            alike = [c for c in found if c.effect.name() == name and c.effect.joint and c.misfit < reach - GAIN]
            if len(alike) > 1:
                effects = (*around.effects, *(c.effect for c in alike))
                chosen.append(self.fitted(effects, alike[0].factors, around, steps=4))
        return [h for h in chosen if h]

    def screened(self, around: Fit, kept: Hypothesis, joints: set[str]) -> tuple[list[Candidate], float]:
        """Order candidates on every other episode.

        Returns:
            Candidates around a fit, the most promising first, and the loss on the same episodes of the hypothesis
            that is kept so far.
        """
        task, halved = self.halved(around)
        return screen(task, halved, self.sizes, joints), self.halved(kept.fit)[1].loss

    def halved(self, found: Fit) -> tuple[Task, Fit]:
        """Return every other episode, and a fit as seen on them."""
        half = np.arange(0, len(self.sub.evidence), 2)
        task = self.sub.select(half)
        return task, found.select(task, half)

    def grown(self, kept: Hypothesis, ranked: Sequence[Hypothesis]) -> Hypothesis | None:
        """Add the best effect, and with it the best of other joints where each lowers the loss by its own; or None."""
        useful = [h for h in ranked if worth(kept) - worth(h) > 0 and self.promising(kept, h)]
        if not useful:
            return None
        self.remember(kept, ranked)
        best = useful[0]
        for other in useful[1:]:
            added, before = other.effects[len(kept.effects) :], best.effects[len(kept.effects) :]
            taken = {effect.joint for effect in before}
            if len(added) > 1 or added[0].joint in {None, *taken} or None in taken or len(best.effects) >= MOST:
                continue
            both = self.fitted((*best.effects, *added), best.fit.factors, best.fit, steps=3)
            if both and best.loss - both.loss > max(GAIN, 0.5 * (kept.loss - other.loss)):
                best = both
        return best

    def remember(self, kept: Hypothesis, ranked: Sequence[Hypothesis]) -> None:
        """Note which effects competed for a joint."""
        ranked = [h for h in ranked if len(h.effects) == len(kept.effects) + 1]
        for h in ranked:
            added = h.effects[-1]
            near = [o.effects[-1] for o in ranked if o is not h and added.joint in (o.effects[-1].joint, None)]
            self.rivals.setdefault(place(added), []).extend(near)

    def exchanged(self, h: Hypothesis) -> Hypothesis:
        """Try other effects in the place of each whose joint is still above the floor: the first found may stand in."""
        if (places := frozenset(map(place, h.effects))) in self.settled:
            return h
        self.settled.add(places)
        for number, effect in enumerate(h.effects):
            joints = self.train.nominal.joints
            if effect.joint is None or self.ratio(h)[joints.index(effect.joint)] <= UNSATISFIED:
                continue
            rest = self.without(h, number)
            if rest is None:
                continue
            found, reach = self.screened(rest.fit, h, {effect.joint})
            others = [c for c in found if c.effect.joint and c.place != place(effect)][:EXCHANGED]
            others = [c for c in others if c.misfit < reach + FAR_BEHIND]
            quick = [self.fitted((*rest.effects, c.effect), c.factors, rest.fit, steps=3) for c in others]
            ranked = sorted((other for other in quick if other), key=lambda other: other.loss)
            best = self.continued(ranked[0]) if ranked else None
            if best and best.loss < h.loss - GAIN:
                self.rivals.setdefault(place(best.effects[-1]), []).append(effect)
                self.report(f"  {effect.name()} exchanged", best)
                return self.exchanged(self.refined(best))
        return h

    def refined(self, h: Hypothesis) -> Hypothesis:
        """Correct for finer physics steps at the hypothesis and fit on."""
        self.sub = self.sub.held(h.effects, h.fit.factors).corrected(h.effects, h.fit.factors)
        self.held = self.held.held(h.effects, h.fit.factors).corrected(h.effects, h.fit.factors)
        found = fit(self.sub, h.fit.unknowns, h.fit.numbers, steps=5, renewals=1)
        return self.judged(found) if found else h

    def continued(self, h: Hypothesis) -> Hypothesis:
        """Fit further from where a short fit ended, with its slopes as long as they serve."""
        found = fit(self.sub, h.fit.unknowns, h.fit.numbers, lent_slopes(h.fit, h.fit.unknowns), renewals=1)
        return self.judged(found) if found else h

    def pruned(self, kept: Hypothesis) -> Hypothesis:
        """Leave out every effect that held-out episodes do not need, the least needed first."""
        while kept.effects:
            rests = [self.without(kept, number) for number in range(len(kept.effects))]
            spare = [rest for rest in rests if rest is not None and not self.needs(rest, kept)]
            if not spare:
                return kept
            kept = min(spare, key=lambda rest: rest.loss)
            self.report("dropped to", kept)
        return kept

    def without(self, kept: Hypothesis, number: int) -> Hypothesis | None:
        """Return the hypothesis with one effect fewer, fitted anew."""
        rest = tuple(effect for place, effect in enumerate(kept.effects) if place != number)
        if not rest:
            return self.judged(self.null.fit)
        if (kept.effects, number) not in self.fewer:
            self.fewer[kept.effects, number] = self.rival(rest, kept)
        return self.fewer[kept.effects, number]

    def promising(self, without: Hypothesis, with_: Hypothesis) -> bool:
        """Whether more effects lower the held-out error at all, and of one joint by what could be worth a name."""
        logs = self.logs(without, with_).mean(0)
        noticed = np.exp(logs.min()) <= NOTICEABLE or self.relieves(without, with_)
        return bool(logs.sum() < 0 and noticed)

    def needs(self, without: Hypothesis, with_: Hypothesis) -> bool:
        """Whether an effect is worth its name: on held-out episodes, or for a base that it leaves as it should be."""
        logs = self.logs(without, with_)
        best = int(logs.mean(0).argmin())
        wins = float((logs[:, best] < 0).mean())
        enough = BETTER if self.ratio(with_)[best] < POOR else MUCH_BETTER
        better = np.exp(logs.mean(0)[best]) <= enough and wins >= WINS
        return bool(better or (logs.sum() < 0 and self.relieves(without, with_)))

    @staticmethod
    def relieves(without: Hypothesis, with_: Hypothesis) -> bool:
        """Whether the base had to go further from the model without an effect than a real arm's does."""
        return without.loss - with_.loss > PLAUSIBLE and bool(strained(without))

    def logs(self, without: Hypothesis, with_: Hypothesis) -> np.ndarray:
        """Return the log of the ratio of held-out errors, shape (E, n); negative where the effect helps."""
        floor = self.held.floor**2
        return np.asarray(0.5 * np.log((floor + with_.heldout) / (floor + without.heldout)))

    def ratio(self, hypothesis: Hypothesis) -> np.ndarray:
        """Return the held-out error over the floor, the median over episodes, shape (n,)."""
        return np.asarray(np.sqrt(np.median(hypothesis.heldout, axis=0)) / self.held.floor)

    def report(self, word: str, h: Hypothesis) -> None:
        """Say what was found."""
        self.say(f"{word}: {h.text()}; loss {h.loss:.1f}, rest/floor {' '.join(f'{r:.2f}' for r in self.ratio(h))}")
