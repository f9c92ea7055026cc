"""State of a search: objective, episodes, and hypotheses fitted to them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from nas_data.arrays import thin_evenly
from nas_data.effects.base import Effect, Scales
from nas_data.gap.floor import compute_floor_ratios
from nas_data.gap.search.constants import (
    AT_FLOOR,
    AT_USUAL_ERROR,
    EXPLAINED,
    FAR_ABOVE,
    FAR_BEHIND,
    MAX_LEADERS,
    MAX_ROUNDS,
    NEGLIGIBLE_GAIN,
    ODD_ERROR,
    SEARCH_EPISODES,
    SEARCH_ROWS,
)
from nas_data.gap.search.contrast import Contrast
from nas_data.gap.search.fit import Fit, evaluate_loss, fit, is_effect_or_freed, measure_jacobian, measure_moved_joints
from nas_data.gap.search.hypothesis import (
    Description,
    Hypothesis,
    Key,
    excited_joints,
    find_joints_beyond_prior,
    reuse_jacobian,
)
from nas_data.gap.search.objective import FitTask
from nas_data.gap.search.row_weights import weigh_rows
from nas_data.gap.search.scales import estimate_scales
from nas_data.gap.search.score import Score
from nas_data.gap.search.screen import Candidate, Changes, screen
from nas_data.gap.search.timestep import choose_timestep
from nas_data.gap.search.torque_scale import Start, leave_out

SHOWN_PARTS = 3  # most effects and base parameters in a progress message
SHOWN_JOINTS = 6  # joints up to which a progress message lists the rest of each


@dataclass(frozen=True)
class Round:
    """Objective of a search with the hypotheses scored by it.

    Attributes:
        task: Model and fitted episodes.
        held: Model and held-out episodes.
        nominal: Model as given.
        null: Model with its own parameters fitted.
        measured_at: Positions at which columns of bounded parameters were last measured [rad; m], shape (E, T, n).
    """

    task: FitTask
    held: FitTask
    nominal: Hypothesis
    null: Hypothesis
    measured_at: np.ndarray


@dataclass
class Search:
    """Search for missing effects in one dataset.

    Attributes:
        train: Model and training episodes.
        held: Model and held-out episodes.
        say: Receives progress messages.
        contrast: Recording without the change to be named, if there is one.
        rivals: Effects that competed with an effect when it was added, by name and joint.
        swaps_tried: Sets of effects for which swaps were tried.
        clear_winners: Sets of effects whose last addition was far ahead of all other candidates.
        known_changes: Simulated changes of candidates; see `screen`.
    """

    train: FitTask
    held: FitTask
    say: Callable[[str], None] = lambda text: None
    contrast: Contrast | None = None
    rivals: dict[Key, list[Effect]] = field(default_factory=dict)
    swaps_tried: set[frozenset[Key]] = field(default_factory=set)
    clear_winners: set[frozenset[Key]] = field(default_factory=set)
    known_changes: Changes = field(default_factory=dict)

    @classmethod
    def begin(
        cls,
        train: FitTask,
        held: FitTask,
        say: Callable[[str], None] = lambda text: None,
        contrast: Contrast | None = None,
    ) -> "Search":
        """Start a search: select its episodes, and fit the model's own parameters within their prior."""
        search = cls(train, held, say, contrast)
        parameters = Description().parameters(train.nominal.base)
        start = parameters.initial_theta()
        search.task = train.select(choose_episodes(train)).relinearise(parameters, start)
        search.held = held.relinearise(parameters, start).with_tolerance_of(search.task)
        predicted = search.task.predict(parameters, start)
        assert predicted is not None, "the model was rolled out before"
        jacobian = measure_jacobian(search.task, parameters, start, predicted, range(parameters.size))
        search.train = replace(train, moved_by_base=measure_moved_joints(search.task, parameters, predicted, jacobian))
        search.task = replace(search.task, moved_by_base=search.train.moved_by_base)
        misfit = search.task.misfit(predicted)
        nominal = Fit(parameters, start, predicted, misfit, jacobian, search.task.objective)
        search.nominal = search.evaluate(Description(), nominal)
        search.measured_at = predicted
        search.scales = estimate_scales(train.nominal, search.task.evidence, predicted)
        search.excited = excited_joints(train)
        null = search.fit_description(Description(), {}, nominal, steps=8)
        search.null = search.nominal
        if null is not None and null.score < search.nominal.score:
            search.null = search.update_objective(null.description, null.fit)
        search.report("the model alone", search.null)
        return search

    def __post_init__(self) -> None:
        self._cache: dict[object, Hypothesis | None] = {}
        self.task: FitTask = self.train
        self.nominal: Hypothesis
        self.null: Hypothesis
        self.measured_at: np.ndarray
        self.scales: tuple[Scales, ...] = ()
        self.excited: set[str] = set()
        self.at_floor = AT_USUAL_ERROR if self.contrast else AT_FLOOR

    def evaluate(self, description: Description, found: Fit, held: FitTask | None = None) -> Hypothesis:
        """Return a fit as a hypothesis with held-out errors, by default with the initial states of the search."""
        held = held or self.held
        fitted = description.with_effects(found.effects)
        predicted = held.predict(found.parameters, found.theta)
        if predicted is None:
            lost = np.full((len(held.evidence), len(held.floor)), np.inf)
            return Hypothesis(fitted, found, lost, np.inf)
        shared = 0.0
        if self.contrast:
            counted = float(self.task.observations.sum() + held.observations.sum())
            shared = self.contrast.measure_gain(found.effects, counted)
        return Hypothesis(fitted, found, held.mean_squares(predicted), held.misfit(predicted), shared)

    def fit_description(
        self,
        description: Description,
        factors: dict[str, float],
        near: Fit | None = None,
        steps: int = 6,
        jacobian_refreshes: int = 0,
    ) -> Hypothesis | None:
        """Fit a description from its guesses, reusing columns of `near`; None if the model diverges."""
        parameters = description.parameters(self.train.nominal.base)
        known = reuse_jacobian(near, parameters)
        found = fit(self.task, parameters, parameters.initial_theta(factors), known, steps, jacobian_refreshes)
        return None if found is None else self.evaluate(description, found)

    def ends_with_equivalent(self, h: Hypothesis) -> bool:
        """Whether another effect is named instead of the last one, because it is equivalent."""
        last = h.effects[-1]
        if last.joint is None:
            return False
        return last.has_preferred_equivalent(self.find_scales(last.joint))

    def find_scales(self, joint: str) -> Scales:
        """Return the scales of a joint."""
        return self.scales[self.train.nominal.joints.index(joint)]

    def evaluate_loss(self, description: Description, factors: dict[str, float]) -> Score:
        """Return the loss of a description at its values."""
        parameters = description.parameters(self.train.nominal.base)
        return evaluate_loss(self.task, parameters, parameters.initial_theta(factors))

    def fit_rival(self, description: Description, kept: Hypothesis, scaled: Start | None = None) -> Hypothesis | None:
        """Fit a description in place of the kept one, further if its score is near; results are cached.

        Args:
            description: Description with the kept hypothesis's values.
            kept: Hypothesis.
            scaled: The same description and factors of the model with other values, from which the fit starts if their
                loss is lower.
        """
        identity = ("rival", description, kept.description, self.task.objective)
        if identity not in self._cache:
            start = (description, kept.fit.factors)
            if scaled is not None and self.evaluate_loss(*scaled) < self.evaluate_loss(*start):
                start = scaled
            found = self.fit_description(*start, kept.fit, steps=4)
            near = found is not None and found.score.over(kept.score) < FAR_BEHIND
            self._cache[identity] = self.fit_further(found) if found is not None and near else found
        return self._cache[identity]

    def fit_further(self, h: Hypothesis) -> Hypothesis:
        """Fit a hypothesis further, reusing its Jacobian."""
        parameters = h.fit.parameters
        found = fit(
            self.task, parameters, h.fit.theta, reuse_jacobian(h.fit, parameters, fresh=1), jacobian_refreshes=1
        )
        return self.evaluate(h.description, found) if found else h

    def relinearise(self, h: Hypothesis) -> Hypothesis:
        """Begin a new round at a hypothesis: update the objective and fit, repeatedly while this gains much.

        A hypothesis that has not converged makes wrong effects look useful, because fits with them move further along
        the valley of the other parameters. If much changes, the bounded base parameters also restart at the model's
        values, since they had compensated for the missing effect.
        """
        for _ in range(MAX_ROUNDS):
            better = self.fit_round(h)
            gained = self.null.score.over(better.score)
            if self.rescore(h).score.over(better.score) < max(FAR_BEHIND, NEGLIGIBLE_GAIN * gained):
                return self.retry_if_chaotic(better)
            h = self.fit_anew(better)
        return h

    def retry_if_chaotic(self, h: Hypothesis) -> Hypothesis:
        """Fit a hypothesis anew if the motion is chaotic, because such a fit stops at any of many minima."""
        return self.fit_anew(h) if self.task.has_unpredictable_rows else h

    def fit_anew(self, h: Hypothesis) -> Hypothesis:
        """Fit a hypothesis from its effects and the model's own bounded parameters; return it or this, by score."""
        freed = {name: h.fit.factors[name] for name in h.description.freed}
        found = self.fit_description(h.description, freed, jacobian_refreshes=1)
        return found if found is not None and found.score < h.score else h

    def fit_round(self, h: Hypothesis) -> Hypothesis:
        """Update the objective at a hypothesis, and fit it.

        Columns of bounded parameters are measured again only when the misfit has fallen far since the last time.
        """
        start = self.weigh_rows(h)
        self.task = self.task.relinearise(h.fit.parameters, h.fit.theta)
        parameters = h.fit.parameters
        known = {c: rows for c, rows in enumerate(h.fit.jacobian) if not is_effect_or_freed(parameters, c)}
        if self.task.misfit(self.measured_at) > self.task.misfit(h.fit.predicted) + FAR_BEHIND:
            known, self.measured_at = {}, h.fit.predicted
        found = fit(self.task, parameters, start, known, steps=5, jacobian_refreshes=1)
        return self.update_objective(h.description, found or h.fit)

    def weigh_rows(self, h: Hypothesis) -> np.ndarray:
        """Weigh rows by how well a hypothesis predicts them, once no joint is far from explained; return its start."""
        if self.floor_ratios(h).max() > FAR_ABOVE:
            self.task, self.held = replace(self.task, row_weights=1.0), replace(self.held, row_weights=1.0)
            return h.fit.theta
        self.task, self.held, start = weigh_rows(self.task, self.held, h.fit)
        return start

    def update_objective(self, description: Description, found: Fit) -> Hypothesis:
        """Choose the physics steps with the lower loss for a fit, and score all kept hypotheses again."""
        task, found = choose_timestep(self.task, found)
        self.task = task.with_new_objective()
        found = replace(found, objective=self.task.objective)
        held = replace(self.held, fine=self.task.fine).reestimate(found.parameters, found.theta)
        self.held = held.with_tolerance_of(self.task)
        self._cache.clear()
        self.nominal, self.null = self.rescore(self.nominal), self.rescore(self.null)
        return self.rescore(self.evaluate(description, found))

    def make_friction_firm(self, firm: Mapping[str, float]) -> None:
        """Go on with a model whose friction is firm in some joints; other hypotheses must be scored again.

        Args:
            firm: Factors of `JOINT.solimpfriction`.
        """
        self.train, self.task = self.train.with_firm_friction(firm), self.task.with_firm_friction(firm)
        self.held = self.held.with_firm_friction(firm).with_tolerance_of(self.task)
        self._cache.clear()
        self.known_changes.clear()
        self.nominal, self.null = self.rescore(self.nominal), self.rescore(self.null)

    @property
    def current_round(self) -> Round:
        """Present objective with the hypotheses scored by it, for `return_to`."""
        return Round(self.task, self.held, self.nominal, self.null, self.measured_at)

    def return_to(self, round_: Round) -> None:
        """Return to an earlier objective; other hypotheses must be scored again."""
        reach = self.task.moved_by_joint
        self.task, self.held, self.nominal, self.null, self.measured_at = vars(round_).values()
        self.task = replace(self.task, moved_by_joint=reach)
        self._cache.clear()

    def rescore(self, h: Hypothesis) -> Hypothesis:
        """Return a hypothesis scored by the present objective."""
        if h.fit.objective == self.task.objective:
            return h
        predicted = self.task.predict(h.fit.parameters, h.fit.theta)
        if predicted is None:
            return replace(h, fit=replace(h.fit, misfit=np.inf, objective=self.task.objective))
        found = replace(h.fit, predicted=predicted, misfit=self.task.misfit(predicted), objective=self.task.objective)
        return self.evaluate(h.description, found)

    def without_effect(self, kept: Hypothesis, number: int) -> Hypothesis | None:
        """Fit the hypothesis without the effect of an index; None if the model diverges."""
        description = kept.description.without_effect(number)
        if not description.effects and not description.freed:
            return self.null
        identity = ("without", kept.description, number, self.task.objective)
        if identity not in self._cache:
            scaled = leave_out(kept.description, kept.fit.factors, self.train.nominal.spec, number)
            self._cache[identity] = self.fit_rival(description, kept, scaled)
        return self._cache[identity]

    def screen_candidates(self, around: Fit, kept: Hypothesis, joints: set[str]) -> tuple[list[Candidate], Score]:
        """Screen candidates on every other episode.

        Args:
            around: Fit to which candidates are added.
            kept: Hypothesis kept so far.
            joints: Joints of the candidates.

        Returns:
            Candidates sorted by loss, and the loss of the kept hypothesis on the same episodes.
        """
        half = np.arange(0, len(self.task.evidence), 2)
        task = self.task.select(half)
        found = screen(task, around.select(task, half), self.scales, joints, self.known_changes)
        return found, kept.fit.select(task, half).loss

    def log_error_ratios(self, without: Hypothesis, with_: Hypothesis) -> np.ndarray:
        """Return the log ratio of held-out errors with over without an effect, shape (E, n)."""
        same = self.held.tolerance
        return np.asarray(0.5 * np.log((same + with_.heldout) / (same + without.heldout)))

    def floor_ratios(self, hypothesis: Hypothesis) -> np.ndarray:
        """Return the held-out error over the noise floor, geometric mean over episodes, shape (n,)."""
        return compute_floor_ratios(hypothesis.heldout, self.held.floors)

    def count_unexplained(self, hypothesis: Hypothesis) -> int:
        """Return the number of excited joints whose held-out error is far above the floor."""
        errors = zip(self.train.nominal.joints, self.floor_ratios(hypothesis), strict=True)
        return sum(ratio > EXPLAINED for joint, ratio in errors if joint in self.excited)

    def find_joints_above_floor(self, hypothesis: Hypothesis) -> set[str]:
        """Return the excited joints above their floor or with base parameters beyond their prior."""
        errors = zip(self.train.nominal.joints, self.floor_ratios(hypothesis), strict=True)
        above = {joint for joint, ratio in errors if ratio > self.at_floor}
        return (above | find_joints_beyond_prior(hypothesis)) & self.excited

    def report(self, word: str, h: Hypothesis) -> None:
        """Write a hypothesis with its score to the progress messages."""
        ratios = self.floor_ratios(h)
        left = " ".join(f"{ratio:.1f}" for ratio in ratios)
        if len(ratios) > SHOWN_JOINTS:
            left = f"{ratios.min():.1f} to {ratios.max():.1f}"
        self.say(f"{word}: {h.describe(SHOWN_PARTS)}; score {h.score.nats:.1f}, {left} noise floors")


def choose_episodes(task: FitTask) -> np.ndarray:
    """Return indices of the search's episodes, shape (k,): evenly spaced ones, and those with the largest errors."""
    count, steps = task.evidence.commands.shape[:2]
    wanted = max(SEARCH_EPISODES, SEARCH_ROWS // steps)
    even = thin_evenly(count, wanted)
    squares = task.floors**2 + task.evidence.mean_squares(task.nominal.predict(task.evidence))
    oddness = np.sqrt((squares / np.median(squares, axis=0)).max(axis=1))
    oddness[even] = 0.0
    odd = [episode for episode in np.argsort(-oddness)[:MAX_LEADERS] if oddness[episode] > ODD_ERROR]
    return np.sort(np.concatenate([even, np.array(odd, dtype=int)]))
