"""Errors of a predictor on held-out episodes, with the baselines source, hold and command."""

from nas_data.dataset.dataset import Dataset
from nas_data.metrics import Errors
from nas_data.models.evaluation import MODEL, Evaluation, evaluate
from nas_data.sources import SourceModel
from nas_data.studies.ablation.kinds.base import Learned
from nas_data.typed_json import finite

SOURCE = "source"
BASELINES = (SOURCE, "hold", "command")


def judge(kind: str, learned: Learned, plain: SourceModel | None, held: Dataset) -> dict[str, object]:
    """Compare predictions of a predictor and of the baselines with measurements.

    Args:
        kind: Name of the predictor.
        learned: The predictor.
        plain: Plain source; None if there is none.
        held: Held-out transitions.

    Returns:
        `one_step` and `open_loop`, the errors [rad] by predictor: overall, mean of the episodes, per joint, per
        episode; null after divergence.
    """
    with_model = evaluation(learned.source, learned, held)
    own = SOURCE if learned.model is None else MODEL[learned.model.kind]
    without = with_model if learned.source is plain else evaluation(plain, Learned(None, plain), held)
    return {
        "unit": with_model.open_loop[own].unit.si,
        "one_step": described(kind, with_model.one_step[own], without.one_step),
        "open_loop": described(kind, with_model.open_loop[own], without.open_loop),
    }


def evaluation(source: SourceModel | None, learned: Learned, held: Dataset) -> Evaluation:
    """Evaluate a model on a source; either may be missing."""
    simulator = None if source is None else source.simulator(held, threads=1)
    return evaluate(held, simulator, learned.model)


def described(kind: str, own: Errors, baselines: dict[str, Errors]) -> object:
    """Return errors by predictor for JSON."""
    return finite({kind: own.to_json(), **{name: baselines[name].to_json() for name in BASELINES if name in baselines}})
