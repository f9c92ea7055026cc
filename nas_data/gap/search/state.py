"""The state of a search: the episodes it works on, and hypotheses fitted to and judged by them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from nas_data.effects.base import Effect
from nas_data.gap.floor import ratios
from nas_data.gap.search.fit import Fit, Task, fit, slopes
from nas_data.gap.search.hypothesis import Hypothesis, Place, lent_slopes, lively
from nas_data.gap.search.scales import scales
from nas_data.gap.search.screen import Candidate, screen
from nas_data.gap.search.steps import stepped
from nas_data.gap.search.unknowns import Unknowns, free_base

SCREENED = 6  # episodes on which candidates are compared
SCREENED_ROWS = 1800  # rows on which they are compared at least, where episodes are short
ODD = 3.0  # times the usual error of a joint from which an episode is odd, and looked at besides
ODDEST = 2  # odd episodes at most
FAR_BEHIND = 60.0  # nats by which a rival may lie behind after a few steps and still be fitted to the end


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
        beaten: What was fitted in the place of what is kept, by the effects of both and the steps.
    """

    train: Task
    held: Task
    say: Callable[[str], None] = lambda text: None
    rivals: dict[Place, list[Effect]] = field(default_factory=dict)
    settled: set[frozenset[Place]] = field(default_factory=set)
    fewer: dict[tuple[tuple[Effect, ...], int], Hypothesis | None] = field(default_factory=dict)
    beaten: dict[tuple[tuple[Effect, ...], tuple[Effect, ...], int], Hypothesis | None] = field(default_factory=dict)

    def __post_init__(self) -> None:
        unknowns = Unknowns((), self.train.nominal.base)
        start = unknowns.start()
        self.sub = self.train.select(telling(self.train)).focused(unknowns, start)
        self.held = self.held.focused(unknowns, start)
        predicted = self.sub.predict(unknowns, start)
        assert predicted is not None, "the model was rolled out before"
        grad = slopes(self.sub, unknowns, start, predicted, range(unknowns.size))
        self.nominal = self.judged(Fit(unknowns, start, predicted, self.sub.misfit(predicted), grad))
        self.sizes = scales(self.train.nominal, self.sub.evidence, predicted)
        self.lively = lively(self.train)
        null = self.fitted((), {}, self.nominal.fit, steps=8, renewals=1)
        self.null = self.nominal if null is None or null.loss > self.nominal.loss else self.in_steps(null.fit)
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
        """Fit other effects in the place of those kept, thoroughly where they come near; once."""
        key = (tuple(effects), kept.effects, steps)
        if key not in self.beaten:
            found = self.fitted(effects, kept.fit.factors, kept.fit, steps)
            self.beaten[key] = found if found is None or found.loss > kept.loss + FAR_BEHIND else self.continued(found)
        return self.beaten[key]

    def continued(self, h: Hypothesis) -> Hypothesis:
        """Fit further from where a short fit ended, with its slopes as long as they serve."""
        found = fit(self.sub, h.fit.unknowns, h.fit.numbers, lent_slopes(h.fit, h.fit.unknowns, fresh=1), renewals=1)
        return self.judged(found) if found else h

    def refined(self, h: Hypothesis) -> Hypothesis:
        """Correct for finer physics steps at the hypothesis and fit on."""
        self.sub = self.sub.focused(h.fit.unknowns, h.fit.numbers)
        self.held = self.held.focused(h.fit.unknowns, h.fit.numbers)
        found = fit(self.sub, h.fit.unknowns, h.fit.numbers, steps=5, renewals=1)
        return self.in_steps(found) if found else h

    def in_steps(self, found: Fit) -> Hypothesis:
        """Take the physics steps, the model's own or finer ones, that leave a fit less; judge it with them."""
        self.sub, found = stepped(self.sub, found)
        if self.held.fine != self.sub.fine:
            self.held = replace(self.held, fine=self.sub.fine).focused(found.unknowns, found.numbers)
        return self.judged(found)

    def without(self, kept: Hypothesis, number: int) -> Hypothesis | None:
        """Return the hypothesis with one effect fewer, fitted anew."""
        rest = tuple(effect for place, effect in enumerate(kept.effects) if place != number)
        if not rest:
            return self.judged(self.null.fit)
        if (kept.effects, number) not in self.fewer:
            self.fewer[kept.effects, number] = self.rival(rest, kept)
        return self.fewer[kept.effects, number]

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

    def logs(self, without: Hypothesis, with_: Hypothesis) -> np.ndarray:
        """Return the log of the ratio of held-out errors, shape (E, n); negative where the effect helps."""
        same = self.held.tolerated
        return np.asarray(0.5 * np.log((same + with_.heldout) / (same + without.heldout)))

    def ratio(self, hypothesis: Hypothesis) -> np.ndarray:
        """Return the held-out error over the floor, the geometric mean over episodes, shape (n,)."""
        return ratios(hypothesis.heldout, self.held.floor)

    def report(self, word: str, h: Hypothesis) -> None:
        """Say what was found."""
        self.say(f"{word}: {h.text()}; loss {h.loss:.1f}, rest/floor {' '.join(f'{r:.2f}' for r in self.ratio(h))}")


def telling(task: Task) -> np.ndarray:
    """Return the numbers of the episodes to search on: some evenly, and the oddest: a limit is reached in few."""
    count, steps = task.evidence.commands.shape[:2]
    wanted = max(SCREENED, SCREENED_ROWS // steps)
    even = np.unique(np.linspace(0, count - 1, min(count, wanted)).round().astype(int))
    squares = task.floor**2 + task.evidence.mean_squares(task.nominal.predict(task.evidence))
    oddness = np.sqrt((squares / np.median(squares, axis=0)).max(axis=1))
    oddness[even] = 0.0
    odd = [episode for episode in np.argsort(-oddness)[:ODDEST] if oddness[episode] > ODD]
    return np.sort(np.concatenate([even, np.array(odd, dtype=int)]))
