"""The state of a search: the objective, the episodes it works on, and hypotheses fitted to and judged by them."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from nas_data.effects.base import Effect, Scales
from nas_data.gap.floor import ratios
from nas_data.gap.search.fit import Fit, fit, is_loose, loss, measure_jacobian, measure_reach
from nas_data.gap.search.hypothesis import (
    Description,
    Hypothesis,
    Key,
    excited_joints,
    joints_beyond_prior,
    reuse_jacobian,
)
from nas_data.gap.search.objective import FitTask, Score
from nas_data.gap.search.scales import scales
from nas_data.gap.search.screen import Candidate, Changes, screen
from nas_data.gap.search.timestep import choose_timestep

SCREENED = 6  # episodes on which candidates are compared
SCREENED_ROWS = 1800  # rows on which they are compared at least, where episodes are short
ODD = 3.0  # times the usual error of a joint from which an episode is odd, and looked at besides
ODDEST = 2  # odd episodes at most
AT_FLOOR = 1.15  # noise floors of rest up to which nothing is looked for
FAR_BEHIND = 60.0  # nats from which a difference decides, though fits are short or estimates of first order
LITTLE = 0.05  # of all that was gained, which then is too little to go on
TRIED = 3  # alternatives that are fitted where several promise
ROUNDS = 3  # over one set of alternatives, at most


@dataclass(frozen=True)
class Round:
    """An objective of a search.

    Attributes:
        sub: Model and episodes that are fitted.
        held: Model and held-out episodes.
        nominal: The model as it is, scored by it.
        null: The model with its own parameters fitted.
        measured_at: Positions where the columns of bound parameters were last measured [rad], shape (E, T, n).
    """

    sub: FitTask
    held: FitTask
    nominal: Hypothesis
    null: Hypothesis
    measured_at: np.ndarray


@dataclass
class Search:
    """The search for missing effects in one dataset.

    Attributes:
        train: Model and training episodes.
        held: Model and held-out episodes.
        say: Told what is going on.
        rivals: For each effect and joint, effects that competed with it when it was added.
        settled: Sets of effects in which swaps were tried.
        clear: Sets of effects of which the last one added left every other candidate far behind.
        changes: What candidates of a screening change.
    """

    train: FitTask
    held: FitTask
    say: Callable[[str], None] = lambda text: None
    rivals: dict[Key, list[Effect]] = field(default_factory=dict)
    settled: set[frozenset[Key]] = field(default_factory=set)
    clear: set[frozenset[Key]] = field(default_factory=set)
    changes: Changes = field(default_factory=dict)

    @classmethod
    def begin(cls, train: FitTask, held: FitTask, say: Callable[[str], None] = lambda text: None) -> "Search":
        """Start a search: choose the episodes it works on, and fit the model's own parameters a few percent."""
        search = cls(train, held, say)
        parameters = Description().parameters(train.nominal.base)
        start = parameters.start()
        search.sub = train.select(choose_episodes(train)).relinearise(parameters, start)
        search.held = held.relinearise(parameters, start).at_tolerance_of(search.sub)
        predicted = search.sub.predict(parameters, start)
        assert predicted is not None, "the model was rolled out before"
        jacobian = measure_jacobian(search.sub, parameters, start, predicted, range(parameters.size))
        search.train = replace(train, reach=measure_reach(search.sub, parameters, predicted, jacobian))
        search.sub = replace(search.sub, reach=search.train.reach)
        misfit = search.sub.misfit(predicted)
        nominal = Fit(parameters, start, predicted, misfit, jacobian, search.sub.objective)
        search.nominal = search.judge(Description(), nominal)
        search.measured_at = predicted
        search.sizes = scales(train.nominal, search.sub.evidence, predicted)
        search.excited = excited_joints(train)
        null = search.fitted(Description(), {}, nominal, steps=8)
        search.null = search.nominal
        if null is not None and null.score < search.nominal.score:
            search.null = search.settle(null.description, null.fit)
        search.report("the model alone", search.null)
        return search

    def __post_init__(self) -> None:
        self._cache: dict[object, Hypothesis | None] = {}
        self.sub: FitTask = self.train
        self.nominal: Hypothesis
        self.null: Hypothesis
        self.measured_at: np.ndarray
        self.sizes: tuple[Scales, ...] = ()
        self.excited: set[str] = set()

    def judge(self, description: Description, found: Fit, held: FitTask | None = None) -> Hypothesis:
        """Roll a fit out on the held-out episodes, with the initial states of the search where no others are given."""
        held = held or self.held
        fitted = description.with_effects(found.effects)
        predicted = held.predict(found.parameters, found.theta)
        if predicted is None:
            lost = np.full((len(held.evidence), len(held.floor)), np.inf)
            return Hypothesis(fitted, found, lost, np.inf)
        return Hypothesis(fitted, found, held.evidence.mean_squares(predicted), held.misfit(predicted))

    def fitted(
        self,
        description: Description,
        factors: dict[str, float],
        near: Fit | None = None,
        steps: int = 6,
        jacobian_refreshes: int = 0,
    ) -> Hypothesis | None:
        """Fit a description from guesses; `near` lends columns of its Jacobian. None where the model diverges."""
        parameters = description.parameters(self.train.nominal.base)
        known = reuse_jacobian(near, parameters)
        found = fit(self.sub, parameters, parameters.start(factors), known, steps, jacobian_refreshes)
        return None if found is None else self.judge(description, found)

    def loss_at(self, description: Description, factors: dict[str, float]) -> Score:
        """Return the loss of a description with the values that it has."""
        parameters = description.parameters(self.train.nominal.base)
        return loss(self.sub, parameters, parameters.start(factors))

    def rival(self, description: Description, kept: Hypothesis, steps: int = 4) -> Hypothesis | None:
        """Fit another description in the place of the one kept, thoroughly where it comes near; once."""
        identity = ("rival", description, kept.description, steps, self.sub.objective)
        if identity not in self._cache:
            found = self.fitted(description, kept.fit.factors, kept.fit, steps)
            near = found is not None and found.score.over(kept.score) < FAR_BEHIND
            self._cache[identity] = self.continued(found) if found is not None and near else found
        return self._cache[identity]

    def continued(self, h: Hypothesis) -> Hypothesis:
        """Fit further from where a short fit ended, with its Jacobian as long as that serves."""
        parameters = h.fit.parameters
        found = fit(self.sub, parameters, h.fit.theta, reuse_jacobian(h.fit, parameters, fresh=1), jacobian_refreshes=1)
        return self.judge(h.description, found) if found else h

    def relinearise(self, h: Hypothesis) -> Hypothesis:
        """Begin another round at a hypothesis: a new objective, to which it is fitted, again while that brings much.

        A hypothesis that is not fitted to its end makes a wrong effect beside it look useful: the fit with that effect
        goes further along the valley in which the other parameters lie. The model's bounded parameters had bent to what
        was missing; where much changes, they also begin anew.
        """
        for _ in range(ROUNDS):
            better = self.fit_round(h)
            gained = self.null.score.over(better.score)
            if self.rescore(h).score.over(better.score) < max(FAR_BEHIND, LITTLE * gained):
                return better
            h = min(better, self.fit_anew(better), key=lambda one: one.score)
        return h

    def fit_anew(self, h: Hypothesis) -> Hypothesis:
        """Return a hypothesis fitted from its effects and the model's own bounded parameters."""
        freed = {name: h.fit.factors[name] for name in h.description.freed}
        return self.fitted(h.description, freed, jacobian_refreshes=1) or h

    def fit_round(self, h: Hypothesis) -> Hypothesis:
        """Make the objective anew at a hypothesis, and fit it.

        Columns of bound parameters are kept until a hypothesis is far better than the one at which they were measured.
        """
        self.sub = self.sub.relinearise(h.fit.parameters, h.fit.theta)
        parameters = h.fit.parameters
        known = {c: rows for c, rows in enumerate(h.fit.jacobian) if not is_loose(parameters, c)}
        if self.sub.misfit(self.measured_at) > self.sub.misfit(h.fit.predicted) + FAR_BEHIND:
            known, self.measured_at = {}, h.fit.predicted
        found = fit(self.sub, parameters, h.fit.theta, known, steps=5, jacobian_refreshes=1)
        return self.settle(h.description, found or h.fit)

    def with_own_start(self, h: Hypothesis) -> Hypothesis:
        """Return a hypothesis fitted and scored with the initial states that suit it, at the present tolerance.

        Initial velocities were moved towards what suits the hypothesis that is kept; another one looks worse by them.
        """
        parameters, theta = h.fit.parameters, h.fit.theta
        sub = self.sub.restart(parameters, theta).at_tolerance_of(self.sub)
        found = fit(sub, parameters, theta, reuse_jacobian(h.fit, parameters), steps=3, jacobian_refreshes=0) or h.fit
        held = self.held.restart(found.parameters, found.theta).at_tolerance_of(self.sub)
        return self.judge(h.description, found, held)

    def settle(self, description: Description, found: Fit) -> Hypothesis:
        """Take the physics steps, the model's own or finer ones, that leave a fit less; rescore what else is kept."""
        task, found = choose_timestep(self.sub, found)
        self.sub = task.renewed()
        found = replace(found, objective=self.sub.objective)
        held = replace(self.held, fine=self.sub.fine).restart(found.parameters, found.theta)
        self.held = held.at_tolerance_of(self.sub)
        self._cache.clear()
        self.nominal, self.null = self.rescore(self.nominal), self.rescore(self.null)
        return self.rescore(self.judge(description, found))

    @property
    def begins_in_motion(self) -> bool:
        """Whether some episode begins in motion."""
        return bool((self.sub.evidence.velocity_deviations > 0).any())

    @property
    def round(self) -> Round:
        """The present objective with what is scored by it, to come back to."""
        return Round(self.sub, self.held, self.nominal, self.null, self.measured_at)

    def return_to(self, round_: Round) -> None:
        """Go back to an earlier objective; what was found since is to be rescored, and what moves which joint stays."""
        reach = self.sub.reach_of_joints
        self.sub, self.held, self.nominal, self.null, self.measured_at = vars(round_).values()
        self.sub = replace(self.sub, reach_of_joints=reach)
        self._cache.clear()

    def rescore(self, h: Hypothesis) -> Hypothesis:
        """Return a hypothesis with its score of the present objective."""
        if h.fit.objective == self.sub.objective:
            return h
        predicted = self.sub.predict(h.fit.parameters, h.fit.theta)
        if predicted is None:
            return replace(h, fit=replace(h.fit, misfit=np.inf, objective=self.sub.objective))
        found = replace(h.fit, predicted=predicted, misfit=self.sub.misfit(predicted), objective=self.sub.objective)
        return self.judge(h.description, found)

    def without(self, kept: Hypothesis, number: int) -> Hypothesis | None:
        """Return the hypothesis with one effect fewer, fitted anew."""
        description = kept.description.without(number)
        if not description.effects and not description.freed:
            return self.null
        identity = ("without", kept.description, number, self.sub.objective)
        if identity not in self._cache:
            self._cache[identity] = self.rival(description, kept)
        return self._cache[identity]

    def screened(self, around: Fit, kept: Hypothesis, joints: set[str]) -> tuple[list[Candidate], Score]:
        """Order candidates on every other episode.

        Returns:
            Candidates around a fit, the most promising first, and the loss on the same episodes of the hypothesis
            that is kept so far.
        """
        half = np.arange(0, len(self.sub.evidence), 2)
        task = self.sub.select(half)
        found = screen(task, around.select(task, half), self.sizes, joints, self.changes)
        return found, kept.fit.select(task, half).loss

    def logs(self, without: Hypothesis, with_: Hypothesis) -> np.ndarray:
        """Return the log of the ratio of held-out errors, shape (E, n); negative where the effect helps."""
        same = self.held.tolerated
        return np.asarray(0.5 * np.log((same + with_.heldout) / (same + without.heldout)))

    def ratio(self, hypothesis: Hypothesis) -> np.ndarray:
        """Return the held-out error over the floor, the geometric mean over episodes, shape (n,)."""
        return ratios(hypothesis.heldout, self.held.floor)

    def above_floor(self, hypothesis: Hypothesis) -> set[str]:
        """Return the joints that moved and are above the floor, or bend the model further than a real arm's is off."""
        ratios = zip(self.train.nominal.joints, self.ratio(hypothesis), strict=True)
        above = {joint for joint, ratio in ratios if ratio > AT_FLOOR}
        return (above | joints_beyond_prior(hypothesis)) & self.excited

    def report(self, word: str, h: Hypothesis) -> None:
        """Say what was found."""
        rest = " ".join(f"{ratio:.2f}" for ratio in self.ratio(h))
        self.say(f"{word}: {h.text()}; score {h.score.nats:.1f}, rest/floor {rest}")


def choose_episodes(task: FitTask) -> np.ndarray:
    """Return the numbers of the episodes to search on: some evenly, and the oddest: a limit is reached in few."""
    count, steps = task.evidence.commands.shape[:2]
    wanted = max(SCREENED, SCREENED_ROWS // steps)
    even = np.unique(np.linspace(0, count - 1, min(count, wanted)).round().astype(int))
    squares = task.floor**2 + task.evidence.mean_squares(task.nominal.predict(task.evidence))
    oddness = np.sqrt((squares / np.median(squares, axis=0)).max(axis=1))
    oddness[even] = 0.0
    odd = [episode for episode in np.argsort(-oddness)[:ODDEST] if oddness[episode] > ODD]
    return np.sort(np.concatenate([even, np.array(odd, dtype=int)]))
