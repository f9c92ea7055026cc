"""Errors of a predictor on held-out episodes, with the baselines source, hold and command."""

from collections.abc import Mapping

from nas_data.dataset.dataset import Dataset
from nas_data.metrics import Errors
from nas_data.models.evaluation import MODEL, Evaluation, evaluate
from nas_data.sources import SourceModel
from nas_data.studies.ablation.kinds.base import TrainedPredictor
from nas_data.studies.ablation.results import PredictorErrors, TrialResult
from nas_data.typed_json import make_finite

SOURCE = "source"
BASELINES = (SOURCE, "hold", "command")


def judge(kind: str, learned: TrainedPredictor, plain: SourceModel | None, held: Dataset) -> TrialResult:
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
