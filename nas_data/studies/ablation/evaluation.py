"""Result of a trial: errors of its predictor on held-out episodes, with the baselines source, hold and command."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from nas_data.dataset.dataset import Dataset
from nas_data.joint_units import JointUnit, find_display_unit
from nas_data.metrics import Errors
from nas_data.models.evaluation import Evaluation, evaluate
from nas_data.models.predictions import MODEL
from nas_data.sources import SourceModel
from nas_data.studies.ablation.kinds.base import TrainedPredictor
from nas_data.typed_json import make_finite

METRIC = "mean_of_episodes"  # every held-out episode has equal weight, whatever its length
OPTIONAL = {"optional": True}

PredictorErrors = Mapping[str, Mapping[str, object]]
"""`Errors.to_json` by predictor; null after divergence."""


@dataclass(frozen=True)
class TrainingData:
    """Subset that a trial learned from."""

    episodes: int  # number of episodes, or of segments cut from them
    frames: int  # number of transitions
    minutes: float  # duration [min]
    runs: tuple[tuple[int, int], ...] = ()  # first frame of each segment, and the frame after its last


@dataclass(frozen=True, kw_only=True)
class TrialResult:
    """Result of a trial."""

    failed: str | None = field(default=None, metadata=OPTIONAL)  # why it failed, as a sentence; None if it succeeded
    traceback: tuple[str, ...] | None = field(default=None, metadata=OPTIONAL)  # traceback of an unexpected error
    training_data: TrainingData | None = field(default=None, metadata=OPTIONAL)  # subset that it learned from
    unit: str | None = field(default=None, metadata=OPTIONAL)  # SI unit of the errors
    one_step: PredictorErrors | None = field(default=None, metadata=OPTIONAL)  # One-step errors by predictor
    open_loop: PredictorErrors | None = field(default=None, metadata=OPTIONAL)  # Open-loop errors by predictor
    # named effects, if the kind names any
    effects: tuple[Mapping[str, object], ...] | None = field(default=None, metadata=OPTIONAL)
    # factors of base parameters by name, if the kind names effects
    retuned: Mapping[str, float] | None = field(default=None, metadata=OPTIONAL)
    commit: str | None = None  # commit of this package; None if unknown
    packages: Mapping[str, str] = field(default_factory=dict)  # versions of the installed packages
    wall_seconds: float = 0.0  # wall time [s]
    cpu_seconds: float = 0.0  # processor time [s]

    @property
    def shown(self) -> JointUnit:
        """Display unit of errors: that of hinges, or of slides if the arm has no hinges."""
        return find_display_unit(str(self.unit))

    def predictors(self, loop: str) -> PredictorErrors:
        """Return the errors by predictor, `one_step` or `open_loop`."""
        found = self.one_step if loop == "one_step" else self.open_loop
        assert found is not None  # the trial succeeded
        return found

    def error(self, loop: str, predictor: str) -> float:
        """Return the error [rad] of a predictor; infinite after divergence."""
        value = self.predictors(loop)[predictor][METRIC]
        return math.inf if value is None else float(str(value))


SOURCE = "source"
BASELINES = (SOURCE, "hold", "command")


def evaluate_trial(kind: str, learned: TrainedPredictor, plain: SourceModel | None, held: Dataset) -> TrialResult:
    """Compare predictions of a predictor and of the baselines with measurements.

    Args:
        kind: Name of the predictor.
        learned: The predictor.
        plain: Plain source; None if there is none.
        held: Held-out transitions.

    Returns:
        A result with the errors by predictor, and their unit.
    """
    with_model = evaluate_model(learned.source, learned, held)
    own = SOURCE if learned.model is None else MODEL[learned.model.kind]
    without = with_model if learned.source is plain else evaluate_model(plain, TrainedPredictor(None, plain), held)
    return TrialResult(
        unit=with_model.open_loop[own].unit.si,
        one_step=describe(kind, with_model.one_step[own], without.one_step),
        open_loop=describe(kind, with_model.open_loop[own], without.open_loop),
    )


def evaluate_model(source: SourceModel | None, learned: TrainedPredictor, held: Dataset) -> Evaluation:
    """Evaluate a model on a source; either may be missing."""
    simulator = None if source is None else source.simulator(held, threads=1)
    return evaluate(held, simulator, learned.model)


def describe(kind: str, own: Errors, baselines: Mapping[str, Errors]) -> PredictorErrors:
    """Return the errors of a predictor and of the baselines for JSON."""
    errors = {kind: own, **{name: baselines[name] for name in BASELINES if name in baselines}}
    return {name: {key: make_finite(value) for key, value in one.to_json().items()} for name, one in errors.items()}
